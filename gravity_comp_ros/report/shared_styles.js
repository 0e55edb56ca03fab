// Shares style sheets between elements: each element of a plot has about six, and a report has
// thousands of elements. The page works without this file, only slower. Runs before anything is
// drawn.
const sheet = part('core/dom', 'InlineStyleSheet')
const component = part('core/dom_view', 'DOMComponentView')
const layout = part('models/layouts/layout_dom', 'LayoutDOMView')
const toolbar = part('models/tools/toolbar', 'ToolbarView')
const canvas = part('models/canvas/canvas', 'CanvasView')
// Maximum number of cached sheets; changing texts would otherwise accumulate.
const MAX_SHEETS = 1000

if (sheet._update && component.empty && 'adoptedStyleSheets' in ShadowRoot.prototype) {
  // Most sheets are empty or identical in every plot: each text is one sheet for all elements.
  const {install, uninstall, _update} = sheet, {empty} = component, shared = new Map()
  const sharedSheet = (text) => {
    let known = shared.get(text)
    if (!known) {
      if (shared.size >= MAX_SHEETS) shared.clear()
      shared.set(text, known = new CSSStyleSheet())
      known.replaceSync(text)
    }
    return known
  }
  const put = (root) => {
    root.adoptedStyleSheets = root.sheets.flatMap(each => each.text ? [sharedSheet(each.text)] : [])
  }

  // During a layout, styles are applied only before sizes are read: otherwise the browser
  // recomputes them several times for every plot.
  const late = new Set()
  let laying = false
  const restyle = (root) => laying ? late.add(root) : put(root)
  const applyStyles = () => {
    for (const root of late) put(root)
    late.clear()
  }
  const applyingStyles = (view, name) => {
    const asks = view[name]
    if (asks) view[name] = function () {
      applyStyles()
      return asks.call(this)
    }
  }
  const {invalidate_layout} = layout
  if (invalidate_layout && layout.update_bbox) {
    applyingStyles(layout, 'update_bbox')
    applyingStyles(toolbar, '_after_render')
    layout.invalidate_layout = function () {
      if (laying) return invalidate_layout.call(this)
      laying = true
      try { invalidate_layout.call(this) } finally {
        laying = false
        applyStyles()
      }
    }
    // A canvas gets its size in the layout of its plot and requires none before.
    if (canvas._after_render) canvas._after_render = function () { this.update_style() }
  }

  Object.defineProperty(sheet, 'css', {get() { return this.text || '' }})
  sheet._update = function (text) {
    if (text === this.text) return
    this.text = text
    if (this.root) restyle(this.root)
    else if (this.plain) _update.call(this, text)
  }
  sheet.install = function (root) {
    if (!(root instanceof ShadowRoot)) {
      this.plain = true
      _update.call(this, this.css)
      return install.call(this, root)
    }
    this.root = root
    root.sheets ||= []
    root.sheets.push(this)
    if (this.text) root.adoptedStyleSheets.push(sharedSheet(this.text))
  }
  sheet.uninstall = sheet.remove = function () {
    if (!this.root) return uninstall.call(this)
    this.root.sheets = this.root.sheets.filter(each => each !== this)
    restyle(this.root)
    this.root = null
  }
  component.empty = function () {
    if (this.shadow_el.sheets) {
      this.shadow_el.sheets = []
      this.shadow_el.adoptedStyleSheets = []
    }
    empty.call(this)
  }
}
