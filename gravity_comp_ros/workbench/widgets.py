"""Elements of the page as HTML, its frame with style and script."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.report import markup
from gravity_comp_ros.report.page import SECTIONS

_STYLE = """
body { font-size: 14px }
h1 { font-size: 1.2rem; margin: .2rem 0 0 }
h2, h3 { margin-top: .5rem }
.page { display: grid; grid-template-columns: 250px minmax(0, 1fr); gap: 0 1.4rem }
header { grid-column: 1 / -1; border-bottom: 1px solid var(--line); padding-bottom: .4rem }
main { max-width: 1600px; padding: .6rem 1rem 4rem }
#work { min-width: 0 }
aside { padding-top: .8rem; overflow-wrap: anywhere }
button, .button, select, input { font: inherit; color: var(--text); background: var(--soft);
  border: 1px solid var(--line); border-radius: 4px; padding: .3rem .6rem; max-width: 100% }
button, .button { cursor: pointer; text-align: left; margin: .15rem .3rem .15rem 0;
  overflow-wrap: anywhere; text-decoration: none; display: inline-block }
button:hover, .button:hover { border-color: var(--strong) }
button:disabled { opacity: .5 }
.primary, [aria-pressed=true] { background: var(--strong); color: var(--ground) }
aside label, aside select, aside .text { display: block; width: 100% }
aside .text { margin-bottom: .4rem }
.finding { display: flex; flex-wrap: wrap; gap: 0 .6rem; align-items: center }
.finding p { flex: 1 1 220px; margin: .1rem 0 }
.above { display: grid; grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); gap: 1.4rem }
iframe { width: 100%; min-height: 300px; border: 0 }
.skip { position: absolute; left: -999px }
.skip:focus { left: 1rem; top: .5rem; background: var(--ground); padding: .4rem; z-index: 9 }
/* On a narrow page the result comes first, the settings last. */
@media (max-width: 900px) { .page, .above { grid-template-columns: minmax(0, 1fr) }
  aside { order: 1 } }
@media print { aside { display: none } }
"""

_SCRIPT = """
addEventListener('load', () => {
const at = (id) => document.getElementById(id), frame = at('frame')
const address = (path, more = {}) => {
  const url = new URL(path + location.search, location)
  for (const [name, value] of Object.entries(more)) url.searchParams.set(name, value)
  return url
}
let key = '', view = 'Summary', loaded = {}, kept = {}, before = {}

// The joint that the user has selected, and the selected samples, as long as they are the same.
const selection = () => {
  const plots = frame.contentWindow.Bokeh?.documents[0]
  return {joint: plots?.get_model_by_name('joint')?.value,
          rows: plots?.get_model_by_name('samples')?.selected.indices}
}
const look = (name, fresh) => {
  const now = selection()
  if (now.joint && now.joint != before.joint) kept.joint = now.joint
  kept.rows = fresh ? [] : now.rows || kept.rows || []
  view = name
  for (const tab of document.querySelectorAll('[data-view]'))
    tab.setAttribute('aria-pressed', tab.dataset.view == name)
  frame.contentWindow.location.replace(address('view', {view, key}))
}
frame.addEventListener('load', async () => {
  const inner = frame.contentDocument.documentElement
  inner.classList.toggle('dark', document.documentElement.classList.contains('dark'))
  new ResizeObserver(() => frame.style.height = inner.offsetHeight + 24 + 'px').observe(inner)
  while (frame.contentDocument?.documentElement === inner && !inner.dataset.ready)
    await new Promise(done => setTimeout(done, 50))
  before = selection()
  const plots = frame.contentWindow.Bokeh?.documents[0]
  const joint = plots?.get_model_by_name('joint')
  if (joint && joint.options.some(([value]) => value == kept.joint)) joint.value = kept.joint
  const samples = plots?.get_model_by_name('samples')
  if (samples && kept.rows?.length) samples.selected.indices = kept.rows
})
const show = (parts) => {
  const focused = document.activeElement.id
  for (const [place, html] of Object.entries(parts))
    if (at(place) && loaded[place] !== html) at(place).innerHTML = loaded[place] = html
  for (const link of document.querySelectorAll('[data-file]'))
    link.href = address('file/' + link.dataset.file)
  // A pressed button that has gone moves the focus to the result, for screen readers.
  if (focused && document.activeElement.id != focused)
    (at(focused) && !at(focused).disabled ? at(focused) : at('head')).focus()
  frame.hidden = !parts.key
  if (parts.key && parts.key != key) {
    key = parts.key
    look(view, true)
  }
  document.documentElement.dataset.ready = 'yes'
}
const listen = async () => {
  for (let tag = '';;) {
    try {
      const answer = await fetch(address('shown', {tag}))
      const parts = await answer.json()
      tag = parts.tag
      show(parts)
    } catch {
      at('status').innerHTML = loaded.status = '<p class="warning">The workbench is stopped.</p>'
      tag = ''
      await new Promise(done => setTimeout(done, 2000))
    }
  }
}
const act = (what, value) => fetch(address('act'), {method: 'POST', body: JSON.stringify(
  {what, value, form: [...new FormData(at('settings'))]})})
document.addEventListener('click', ({target}) => {
  const button = target.closest('button')
  if (button?.dataset.view) look(button.dataset.view)
  else if (button?.dataset.act) act(button.dataset.act, button.dataset.value)
})
document.addEventListener('change', ({target}) => {
  if (target.dataset.act) act(target.dataset.act, target.value)
})
at('style').addEventListener('click', () => {
  for (const page of [document, frame.contentDocument])
    page.documentElement.classList.toggle('dark')
})
listen()
})
"""

_BODY = """
<a class="skip" href="#views">Skip to the views</a>
<div class="page">
<header aria-live="polite" id="head" tabindex="-1"><div id="verdict"><h1>Opening …</h1></div>
<div id="status"></div></header>
<aside aria-label="Settings" id="side"><button type="button" id="style">Dark or light</button>
<div id="facts"></div><form id="settings"></form>
</aside>
<div id="work">
<div class="above">
<section aria-label="Missing effects" id="missing"></section>
<section aria-label="Error history" id="history"></section>
</div>
<section aria-label="Views" id="views"><div>{tabs}</div><div id="compare"></div>
<p id="reason" class="quiet"></p><iframe id="frame" name="view" title="View" hidden></iframe>
</section>
</div>
</div>
"""


def page_html() -> str:
    """Return the page; its places are filled by the script."""
    tabs = ''.join(f'<button type="button" data-view="{name}">{name}</button>'
                   for name in SECTIONS)
    return markup.html_page(
        'gravity_comp workbench', _BODY.format(tabs=tabs),
        [markup.COPY, _SCRIPT], 'The workbench requires JavaScript, which is disabled in this '
        'browser. `gravity_comp diagnose --html` writes its tables to a file.', _STYLE,
        "; connect-src 'self'; frame-src 'self'")


def button(label: str, act: str, value: str = '', kind: str = '', disabled: bool = False) -> str:
    """Return a button that requests `act` with a value."""
    return (f'<button type="button" id="{markup.text(f"{act}-{value}")}" class="{kind}" '
            f'data-act="{act}" data-value="{markup.text(value)}"{" disabled" * disabled}>'
            f'{markup.text(label)}</button>')


def select(title: str, name: str, options: Sequence[tuple[str, str]], value: str,
           act: str = '') -> str:
    """Return a drop-down list of (value, text) options, which requests `act` if it changes."""
    entries = ''.join(
        f'<option value="{markup.text(key)}"{" selected" * (key == value)}>{markup.text(text)}'
        '</option>' for key, text in options)
    return (f'<label for="{name}">{markup.text(title)}</label> <select id="{name}" name="{name}" '
            f'data-act="{act}">{entries}</select>')


def box(label: str, name: str, value: str, checked: bool) -> str:
    """Return a check box."""
    return (f'<label><input type="checkbox" name="{name}" value="{markup.text(value)}"'
            f'{" checked" * checked}> <span>{markup.text(label)}</span></label>')


def field(title: str, name: str, value: str) -> str:
    """Return a text field."""
    return (f'<label for="{name}">{markup.text(title)}</label><input class="text" id="{name}" '
            f'name="{name}" value="{markup.text(value)}">')


def download(label: str, name: str) -> str:
    """Return a link to a file, whose address the script completes."""
    return (f'<a class="button" role="button" download="{name}" '
            f'data-file="{name}">{markup.text(label)}</a>')
