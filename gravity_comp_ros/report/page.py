"""The report as one self-contained HTML file, and its sections."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bokeh.core.json_encoder import serialize_json
from bokeh.document import Document
from bokeh.models import Select
from bokeh.resources import Resources
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, Table
from gravity_comp_ros.report.markup import html_page, NO_PLOTS
from gravity_comp_ros.report.section import joint_selector, Section
from gravity_comp_ros.report.style import THEME
from gravity_comp_ros.report.views import arm, effects, model, residuals, summary
from gravity_comp_ros.report.views.summary import headline

# Builds a section.
Maker = Callable[[Contents, Table, Select], Section]
# All sections by short name, in their order on the page.
SECTIONS: dict[str, Maker] = {
    'Summary': lambda contents, table, selector: summary.section(contents, table),
    'Over time': residuals.time_section,
    'Arm': lambda contents, table, selector: arm.section(contents, table),
    'Residual': residuals.section,
    'Effects': lambda contents, table, selector: effects.section(contents, table),
    'Model': lambda contents, table, selector: model.section(contents),
    'Data': lambda contents, table, selector: model.quality(contents),
    'Provenance': lambda contents, table, selector: model.provenance(contents)}
# Sections with plots of the selected joint.
BY_JOINT = ('Over time', 'Residual')

_PLACE = '<div class="plots"></div>'
# MathJax is omitted: it would turn \href in a joint's name into a link.
_COMPONENTS = ('bokeh', 'bokeh-widgets')
# Style of a page with a part of the sections, which is shown in a frame.
_PART = 'main { padding: 0 } h2 { margin-top: .4rem }'
_DRAW = """
window.addEventListener('load', async () => {
  const {Document} = Bokeh.require('document')
  const plots = Document.from_json(JSON.parse(document.getElementById('data').textContent))
  const places = [...document.querySelectorAll('.plots')]
  await Bokeh.embed.add_document_standalone(plots, document.body, places)
  // Everything is painted before the page is marked as ready.
  requestAnimationFrame(() => setTimeout(() => document.documentElement.dataset.ready = 'yes'))
})
"""


def report_html(contents: Contents, names: Sequence[str] = tuple(SECTIONS)) -> str:
    """
    Return the page, which requires no network and no other file.

    :param names: short names of the sections; the headline is that of all.
    """
    # All plots share one table, so that selections are common.
    table = Table(contents)
    selector = joint_selector(contents.joints, contents.worst)
    sections = [SECTIONS[name](contents, table, selector) for name in names]
    selector.visible &= any(name in BY_JOINT for name in names)
    document = Document(theme=THEME)
    # Collect the models once, not once per section.
    with document.models.freeze():
        document.add_root(selector)
        for section in sections:
            if section.plots is not None:
                document.add_root(section.plots)
    # Safe within a script element.
    plots = serialize_json(document.to_json(deferred=False)).replace('<', '\\u003c')
    parts = ''.join(
        f'<section id="{s.key}"><h2>{markup.text(s.title)}</h2>{s.lead}'
        f'{"" if s.plots is None else _PLACE}{s.after}</section>\n' for s in sections)
    links = ''.join(f'<a href="#{s.key}">{markup.text(s.title)}</a>' for s in sections)
    title = ', '.join(report.path.name for report in contents.reports) or 'recording'
    head = '' if len(names) < len(SECTIONS) else (
        f'<p class="quiet">{markup.text(title)} · model '
        f'{markup.text(contents.model_file or "fitted for this report")} · '
        f'{markup.text(contents.when)}</p>'
        f'<h1 id="verdict">{markup.text(markup.units(headline(contents)))}</h1>'
        f'<nav>{links}</nav>')
    body = (f'{head}<div id="joint">{_PLACE}</div>{parts}'
            f'<script type="application/json" id="data">{plots}</script>')
    bokeh = Resources(mode='inline', components=list(_COMPONENTS)).js_raw
    return html_page(f'gravity_comp: {title}', body, [*bokeh, _DRAW, markup.COPY], NO_PLOTS,
                     '' if head else _PART)
