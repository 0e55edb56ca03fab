"""Template and style sheets of the page, its widgets, and messages to the browser."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from bokeh import __version__
from bokeh.models import (
    Button, CheckboxGroup, CustomJS, Div, RadioButtonGroup, Select, TextInput, UIElement)
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import css, markup
from gravity_comp_ros.workbench import access
from jinja2 import Template

# Style of every widget and text; custom properties of the page apply inside them.
INSIDE = """
:host { color: var(--text); font: 14px/1.45 system-ui, "DejaVu Sans", sans-serif }
/* Wide tables scroll within their text, which is no wider than the page. */
.bk-clearfix { min-width: 0; max-width: 100%; width: 100% }
.bk-input-group > label, .bk-btn-group ~ label, label { color: var(--text);
  white-space: normal; overflow-wrap: anywhere }
/* A long label wraps next to its box, not below it. */
label:has(> input[type=checkbox]) { display: flex; align-items: baseline }
.bk-input, select, input[type=text] { background-color: var(--ground); color: var(--text);
  border-color: var(--line) }
""" + css.ARROW + """
.bk-btn { background: var(--soft); color: var(--text); border: 1px solid var(--line);
  white-space: normal; overflow-wrap: anywhere; text-align: left; max-width: 100% }
.bk-btn:hover, .bk-btn:focus { background: var(--soft); color: var(--text);
  border-color: var(--strong) }
.bk-btn.bk-active { background: var(--strong); color: var(--ground) }
.bk-btn:disabled, .bk-btn[disabled] { opacity: .5 }
.bk-btn-primary, .bk-btn-primary:hover, .bk-btn-primary:focus, .bk-btn.bk-active:hover,
.bk-btn.bk-active:focus { background: var(--strong); color: var(--ground);
  border-color: var(--strong) }
.bk-btn-group { flex-wrap: wrap }
:focus-visible { outline: 2px solid var(--strong); outline-offset: 1px }
""" + css.CONTENT + """
h1, h2, h3 { margin-top: .5rem }
.finding { margin: .1rem 0 }
h1 { font-size: 1.2rem; margin: .2rem 0 0 }
"""

# Only scripts of the page run, and only this server is contacted. Bokeh compiles its callbacks,
# which requires 'unsafe-eval'.
_POLICY = """default-src 'none'; base-uri 'none'; form-action 'none';
 script-src 'self' 'nonce-NONCE' 'unsafe-eval'; style-src 'self' 'unsafe-inline';
 img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; worker-src blob:"""

# The scripts of Bokeh are listed here, because its default list includes MathJax, which turns
# formulas in names into links.
_TEMPLATE = """
{% from macros import embed %}
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="POLICY">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{{ title | e }}</title>
<script nonce="NONCE">PREFER_DARK</script>
<script src="static/js/bokeh.min.js?v=VERSION"></script>
<script src="static/js/bokeh-widgets.min.js?v=VERSION"></script>
<style>
""" + css.TOKENS + """
* { box-sizing: border-box }
body { margin: 0; background: var(--ground); color: var(--text);
  font: 14px/1.45 system-ui, "DejaVu Sans", sans-serif }
.page { display: grid; grid-template-columns: 250px minmax(0, 1fr); gap: 0 1.4rem;
  max-width: 1600px; margin: 0 auto; padding: .6rem 1rem 4rem }
header { grid-column: 1 / -1; border-bottom: 1px solid var(--line); padding-bottom: .4rem }
main { min-width: 0 }
aside { padding-top: .8rem; overflow-wrap: anywhere }
input[type=file] { max-width: 100%; font: inherit; color: var(--text) }
.above { display: grid; grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); gap: 1.4rem }
.skip { position: absolute; left: -999px }
.skip:focus { left: 1rem; top: .5rem; background: var(--ground); padding: .4rem; z-index: 9 }
/* On a narrow page the result comes first, the settings last. */
@media (max-width: 900px) { .page, .above { grid-template-columns: minmax(0, 1fr) }
  aside { order: 1 } }
@media print { aside { display: none } }
</style>
</head>
<body>
<noscript><p>The workbench requires JavaScript, which is disabled in this browser.
<code>gravity_comp diagnose --html</code> writes its tables to a file.</p></noscript>
<a class="skip" href="#views">Skip to the views</a>
<div class="page">
<header aria-live="polite" id="head" tabindex="-1">{{ embed(roots.head) }}</header>
<aside aria-label="Settings" id="side">{{ embed(roots.side) }}
<p><label>Upload a recording (or drop it anywhere): one .mcap or .db3 file
<input type="file" id="upload" accept=".mcap,.db3"></label></p>
<p id="upload-status" role="status" class="quiet"></p></aside>
<main>
<div class="above">
<section aria-label="Missing effects" id="missing">{{ embed(roots.missing) }}</section>
<section aria-label="Error history" id="history">{{ embed(roots.history) }}</section>
</div>
<section aria-label="Views" id="views">{{ embed(roots.views) }}</section>
</main>
</div>
<script nonce="NONCE">COPY</script>
<script nonce="NONCE">{UPLOAD}</script>
{{ plot_script | replace('<script', '<script nonce="NONCE"') }}
</body>
</html>
"""


def template(nonce: str) -> Template:
    """Return the template of the page, which runs only scripts with this nonce."""
    text = _TEMPLATE.replace('POLICY', _POLICY).replace('VERSION', __version__)
    text = text.replace('COPY', markup.COPY).replace('UPLOAD', access.SCRIPT)
    text = text.replace('PREFER_DARK', css.PREFER_DARK)
    # A string would be interpreted as blocks of Bokeh's own template.
    return Template(text.replace('NONCE', nonce))


def html(text: str, name: str | None = None, **more: Any) -> Div:
    """Return an element with safe HTML."""
    return Div(text=text, name=name, stylesheets=[INSIDE], sizing_mode='stretch_width',
               disable_math=True, **more)


def button(label: str, action: Callable[[], None], kind: str = 'default',
           **more: Any) -> Button:
    """Return a button."""
    widget = Button(label=printable(label), button_type=kind, stylesheets=[INSIDE], **more)
    widget.on_click(lambda event: action())
    return widget


def select(title: str, options: Sequence[tuple[str, str]], value: str,
           action: Callable[[str], None] | None = None, name: str = '') -> Select:
    """Return a drop-down list of (value, text) options."""
    widget = Select(title=title, value=value, stylesheets=[INSIDE], sizing_mode='stretch_width',
                    options=[(key, printable(text)) for key, text in options], name=name or None)
    if action is not None:
        widget.on_change('value', lambda attribute, old, new: action(new))
    return widget


def boxes(labels: Sequence[str], active: Sequence[int], name: str = '') -> CheckboxGroup:
    """Return check boxes."""
    return CheckboxGroup(labels=[printable(label) for label in labels], active=list(active),
                         stylesheets=[INSIDE], name=name or None)


def field(title: str, value: str, name: str) -> TextInput:
    """Return a text field."""
    return TextInput(title=printable(title), value=value, name=name,
                     stylesheets=[INSIDE], sizing_mode='stretch_width')


def tabs(labels: Sequence[str], action: Callable[[int], None]) -> RadioButtonGroup:
    """Return a row of tabs."""
    widget = RadioButtonGroup(labels=list(labels), active=0, stylesheets=[INSIDE])
    widget.on_change('active', lambda attribute, old, new: action(new))
    return widget


def toggle(element: UIElement) -> None:
    """Toggle the visibility of an element."""
    element.visible = not element.visible


# The session is part of the URL, so that a reload finds it.
_ON_MESSAGE = """
const [what, value, kind, text] = cb_obj.tags
if (what == 'session') {
  const address = new URL(location.href)
  address.searchParams.set('session', value)
  history.replaceState(null, '', address)
} else if (what == 'focus') {
  const element = document.getElementById(value)
  if (element) element.focus()
} else if (what == 'save') {
  const link = document.createElement('a')
  link.href = URL.createObjectURL(new Blob([text], {type: kind}))
  link.download = value
  link.click()
  setTimeout(() => URL.revokeObjectURL(link.href), 10000)
  cb_obj.tags = []
}
"""


class Browser:
    """An invisible element whose tags are messages to the browser."""

    def __init__(self) -> None:
        self.element = Div(visible=False, tags=[], disable_math=True)
        self.element.js_on_change('tags', CustomJS(code=_ON_MESSAGE))

    def send(self, what: str, *values: str) -> None:
        """Send a message: `session` ID, `focus` ELEMENT, or `save` FILE MIME-TYPE TEXT."""
        self.element.tags = []  # so that an equal message is sent again
        self.element.tags = [what, *values]
