"""Smaller parts of the page: status line, session list, downloads, messages to the browser."""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.models import CustomJS, Div
from gravity_comp_ros.facts.fact import Action
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.report import markup
from gravity_comp_ros.workbench.access import ARGUMENT
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.store import Entry

TOGGLE_DARK = "document.documentElement.classList.toggle('dark')"
READY = "document.documentElement.dataset.ready = 'yes'"
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


def status_html(results: Results) -> str:
    """Return the running job, the error, or the last result, with warnings."""
    session = results.session
    job, event = session.worker.job, session.progress
    # A fit of all samples and the settings may give the same warning: show it once.
    warnings = dict.fromkeys(filter(None, (
        session.save_error, session.warning, results.slow_warning(),
        *(session.stage.warnings if session.stage else ()))))
    below = ''.join(f'<p class="warning">{markup.text(text)}</p>' for text in warnings)
    if job is not None:
        stage = f': {event.stage}' if event else ''
        share = f' <progress max="1" value="{event.share:.2f}"></progress>' if event else ''
        return f'<p id="doing">{markup.text(str(job) + stage)} …{share}</p>{below}'
    if session.error:
        return f'<p id="trouble" class="warning">{markup.text(session.error)}</p>{below}'
    return f'<p id="idle" class="quiet">{markup.text(session.done or "Ready")}</p>{below}'


def facts_html(reports: Sequence[ReadReport]) -> str:
    """Return the facts of each recording, a line each; '' if there are none."""
    lines = [(report.path.name, fact) for report in reports for fact in report.facts]
    if not lines:
        return ''
    listed = ''.join(
        f'<li class="{"warning" if fact.action is Action.REFUSED else "quiet"}">'
        f'{markup.text(name)}: {"refused: " * (fact.action is Action.REFUSED)}'
        f'{markup.text(fact.sentence)}</li>' for name, fact in lines)
    return f'<details id="facts" open><summary>Facts of the recordings ({len(lines)})</summary>' \
           f'<ul>{listed}</ul></details>'


def earlier_html(saved: Sequence[Entry], token: str) -> str:
    """Return links to sessions that can be resumed."""
    if not saved:
        return ''
    lines = ''.join(
        f'<li><a href="?{ARGUMENT}={token}&amp;session={markup.text(entry.id)}">'
        f'{markup.text(", ".join(entry.recordings))}</a><br>'
        f'<span class="quiet">{markup.text(entry.changed[:16].replace("T", " "))}, '
        f'{markup.text(", ".join(entry.stages[-3:]))}</span></li>' for entry in saved)
    return f'<details id="earlier"><summary>Earlier sessions ({len(saved)})</summary>' \
           f'<ul>{lines}</ul></details>'
