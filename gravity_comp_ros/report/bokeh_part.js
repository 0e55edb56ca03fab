// The prototype of a class of Bokeh, for the files after this; what a release lacks stays as it is.
const part = (path, name) => {
  try { return Bokeh.require(path)[name].prototype } catch { return {} }
}
