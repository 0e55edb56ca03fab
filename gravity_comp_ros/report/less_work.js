// Removes unnecessary work of Bokeh for every drawn line and element. The page works without this
// file, only slower. Runs before anything is drawn.

// Bokeh looks up every line colour and width in the page's style, which defines none.
part('core/visuals/visual', 'VisualProperties')._get_css_value = () => ''

// Views drawn on the canvas require no DOM element.
for (const view of [part('models/grids/grid', 'GridView'),
                    part('models/renderers/glyph_renderer', 'GlyphRendererView')])
  view.render_to = function () { this.el.hidden = true }

// The search tree of points is built at the first search; a search of the whole area needs none.
const {Indices} = Bokeh.require('core/types')
const spatial = part('core/util/spatial', 'SpatialIndex')
if (spatial.add_empty && spatial.finish && spatial.indices && spatial.bounds) {
  const {add_empty, finish, indices, bounds} = spatial
  const ready = (index) => {
    if (index.waits) finish.call(index)
    index.waits = false
  }
  // Points without a position are never found, so a search of the whole area is not complete.
  spatial.add_empty = function () {
    this.gaps = true
    add_empty.call(this)
  }
  spatial.finish = function () { this.waits = true }
  spatial.indices = function (rect) {
    const {x0, y0, x1, y1} = this._normalize(rect), all = this.bbox
    if (this.index && !this.gaps && x0 <= all.x0 && y0 <= all.y0 && x1 >= all.x1 && y1 >= all.y1)
      return Indices.all_set(this.index.numItems)
    ready(this)
    return indices.call(this, rect)
  }
  spatial.bounds = function (rect) {
    ready(this)
    return bounds.call(this, rect)
  }
}

// Squares of one size are painted directly, without a path and a transform each.
const scatter = part('models/glyphs/scatter', 'ScatterView')
if (scatter._paint) {
  const {_paint} = scatter
  scatter._paint = function (ctx, indices, data) {
    const {fill, line, hatch} = this.visuals
    const {sx, sy, size, angle, marker} = {...this, ...data}
    if (line.doit || hatch.doit) return _paint.call(this, ctx, indices, data)
    if (!fill.doit) return
    if (!(marker.is_Scalar() && marker.value == 'square' && angle.is_Scalar() && !angle.value
          && size.is_Scalar())) return _paint.call(this, ctx, indices, data)
    const wide = size.value, half = wide / 2, {fill_color, fill_alpha} = fill
    let colour = null, alpha = null
    for (const i of indices) {
      if (!(isFinite(sx[i] + sy[i]) && fill.v_doit(i))) continue
      if (fill_color.get(i) !== colour || fill_alpha.get(i) !== alpha) {
        fill.set_vectorize(ctx, i)
        colour = fill_color.get(i)
        alpha = fill_alpha.get(i)
      }
      ctx.fillRect(sx[i] - half, sy[i] - half, wide, wide)
    }
  }
}

// A selection of all rows is the identity.
const bits = part('core/util/bitset', 'BitSet')
if (bits.select) {
  const {select} = bits
  bits.select = function (array) {
    return this.count == array.length ? array : select.call(this, array)
  }
}

// The font size is read from the page once per plot, not once per measured axis.
const plot = part('models/plots/plot_canvas', 'PlotView')
const letters = Object.getOwnPropertyDescriptor(plot, 'base_font_size')
if (letters) Object.defineProperty(plot, 'base_font_size', {
  get() { return this.letters ??= letters.get.call(this) }})
