// What Bokeh does without need for every line and element that it draws; a page works without this
// as well, only slower. Runs before anything is drawn.

// Every colour and width of a line is asked of the page's style, which has none of these.
part('core/visuals/visual', 'VisualProperties')._get_css_value = () => ''

// What is drawn on the canvas alone needs no element beside it.
for (const view of [part('models/grids/grid', 'GridView'),
                    part('models/renderers/glyph_renderer', 'GlyphRendererView')])
  view.render_to = function () { this.el.hidden = true }

// A search tree of all points is of use to who points at them, and not before; a search of all
// that there is needs none.
const {Indices} = Bokeh.require('core/types')
const spatial = part('core/util/spatial', 'SpatialIndex')
if (spatial.add_empty && spatial.finish && spatial.indices && spatial.bounds) {
  const {add_empty, finish, indices, bounds} = spatial
  const ready = (index) => {
    if (index.waits) finish.call(index)
    index.waits = false
  }
  // A point without a place is in no search.
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

// Squares of one size are painted one by one, without a path and a place of their own.
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

// Of all rows, each is where it was.
const bits = part('core/util/bitset', 'BitSet')
if (bits.select) {
  const {select} = bits
  bits.select = function (array) {
    return this.count == array.length ? array : select.call(this, array)
  }
}

// A plot asks the page for the size of its letters at every axis that it measures.
const plot = part('models/plots/plot_canvas', 'PlotView')
const letters = Object.getOwnPropertyDescriptor(plot, 'base_font_size')
if (letters) Object.defineProperty(plot, 'base_font_size', {
  get() { return this.letters ??= letters.get.call(this) }})
