"""Smaller parts of the page: status line, list of sessions, files, what the browser says."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bokeh.models import CustomJS, Div
from gravity_comp_ros.report import markup
from gravity_comp_ros.workbench.jobs import described
from gravity_comp_ros.workbench.open_session import OpenSession
from gravity_comp_ros.workbench.sidebar import Sidebar
from gravity_comp_ros.workbench.store import SavedSession

WithChoice = Callable[[OpenSession, Sidebar], None]

_SAVE = """
if (cb_obj.tags.length < 3) return
const [name, kind, text] = cb_obj.tags
const link = document.createElement('a')
link.href = URL.createObjectURL(new Blob([text], {type: kind}))
link.download = name
link.click()
setTimeout(() => URL.revokeObjectURL(link.href), 10000)
cb_obj.tags = []
"""

TURN_DARK = "document.documentElement.classList.toggle('dark')"
READY = """
const root = document.documentElement
root.dataset.ready = 'yes'
if (matchMedia('(prefers-color-scheme: dark)').matches && !root.classList.contains('dark')) {
  root.classList.add('dark')
  link.text = 'dark'
}
"""
# The name of the session goes into the address, so that a reload finds it again.
_TOLD = """
const [what, value] = cb_obj.tags
if (what == 'session') {
  const address = new URL(location.href)
  address.search = '?session=' + value
  history.replaceState(null, '', address)
} else if (what == 'focus') {
  const place = document.getElementById(value)
  if (place) place.focus()
} else if (what == 'sweep') {
  // Bokeh keeps what a page no longer shows until it counts its models anew.
  for (const each of Bokeh.documents)
    if (each._recompute_all_models) each._recompute_all_models()
}
"""


class Downloads:
    """An invisible part of the page through which files go out."""

    def __init__(self) -> None:
        self.element = Div(visible=False, tags=[])
        self.element.js_on_change('tags', CustomJS(code=_SAVE))

    def give(self, name: str, kind: str, text: str) -> None:
        """Let the browser save `text` as a file of that name."""
        self.element.tags = []
        self.element.tags = [name, kind, text]


def client_link(heard: Callable[[str], None]) -> Div:
    """Return an invisible part through which browser and server tell each other things."""
    made = Div(visible=False, tags=[], name='link', disable_math=True)
    made.js_on_change('tags', CustomJS(code=_TOLD))
    made.on_change('text', lambda attribute, old, new: heard(new))
    return made


def status_html(one: OpenSession) -> str:
    """Return what is being done, what went wrong, or that all is done."""
    job, event = one.worker.running, one.progress
    shown = one.session.stage
    # A fit of all samples warns of them as the choice does: once is enough.
    warnings = dict.fromkeys(filter(None, (one.unsaved, one.warning, one.session.few_slow(),
                                           *(shown.warnings if shown else ()))))
    below = ''.join(f'<p class="warning">{markup.text(text)}</p>' for text in warnings)
    if job is not None:
        stage = f': {event.stage}' if event else ''
        share = f' <progress max="1" value="{event.share:.2f}"></progress>' if event else ''
        return f'<p id="doing">{markup.text(described(job) + stage)} …{share}</p>{below}'
    if one.trouble:
        return f'<p id="trouble" class="warning">{markup.text(one.trouble)}</p>{below}'
    return f'<p id="idle" class="quiet">{markup.text(one.done or "Ready")}</p>{below}'


def earlier_html(saved: Sequence[SavedSession]) -> str:
    """Return links to sessions that can be gone on with."""
    if not saved:
        return ''
    lines = ''.join(
        f'<li><a href="?session={markup.text(one.id)}">{markup.text(", ".join(one.recordings))}'
        f'</a><br><span class="quiet">{markup.text(one.changed[:16].replace("T", " "))}, '
        f'{markup.text(", ".join(one.stages[-3:]))}</span></li>' for one in saved)
    return f'<details id="earlier"><summary>Earlier sessions ({len(saved)})</summary>' \
           f'<ul>{lines}</ul></details>'
