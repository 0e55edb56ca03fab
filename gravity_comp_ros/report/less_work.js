// What Bokeh does without need for every line and element that it draws; a page works without this
// as well, only slower. Runs before anything is drawn.

// Every colour and width of a line is asked of the page's style, which has none of these.
const lines = Bokeh.require('core/visuals/visual').VisualProperties
if (lines) lines.prototype._get_css_value = () => ''

// Every element of a plot has half a dozen style sheets, most of them empty for ever, and each one
// costs time whenever styles are computed. So an empty one is a comment in its place until it says
// something, and one that is told the same again does not change.
const sheet = Bokeh.require('core/dom').InlineStyleSheet.prototype
if (sheet._update) {
  const update = sheet._update
  sheet.install = function (root) {
    if (this.el.textContent) root.append(this.el)
    else root.append(this.place = document.createComment(''))
  }
  sheet.uninstall = function () {
    this.el.remove()
    if (this.place) this.place.remove()
    this.place = null
  }
  sheet._update = function (text) {
    if (text === this.el.textContent) return
    update.call(this, text)
    if (this.place) this.place.replaceWith(this.el)
    this.place = null
  }
}
