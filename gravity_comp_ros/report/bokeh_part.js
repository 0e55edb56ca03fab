// Prototype of a class of Bokeh for the following files; an empty object if the release lacks it.
const part = (path, name) => {
  try { return Bokeh.require(path)[name].prototype } catch { return {} }
}
