"""The report as one HTML file, with all that it needs inside."""

from __future__ import annotations

from bokeh.document import Document
from bokeh.embed import components
from bokeh.resources import INLINE
from gravity_comp_ros.report import css, markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.sections import all_sections
from gravity_comp_ros.report.style import LIGHT
from gravity_comp_ros.report.verdict import verdict

# Nothing may be fetched: what the page needs is in it.
_POLICY = ("default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; "
           "style-src 'unsafe-inline'; img-src data: blob:; font-src data:")
# Bokeh's own mark of a page that is drawn, for people who wait and for tests.
_READY = """
window.addEventListener('load', () => {
  const wait = () => document.querySelectorAll('.plots').length ==
    document.querySelectorAll('.plots > * > *').length
  const look = () => wait() ? document.documentElement.dataset.ready = 'yes'
                            : setTimeout(look, 50)
  look()
})
"""


def report_html(contents: Contents) -> str:
    """Return the whole page; needs no network and no other file."""
    sections = all_sections(contents, LIGHT)
    plots = {s.key: s.plots for s in sections if s.plots is not None}
    document = Document()
    with document.models.freeze():
        for root in plots.values():
            document.add_root(root)
    script, places = components(plots) if plots else ('', {})
    body = ''.join(_section(s, places.get(s.key, '')) for s in sections)
    links = ''.join(f'<a href="#{s.key}">{markup.text(s.title)}</a>' for s in sections)
    title = ', '.join(report.path.name for report in contents.reports) or 'recording'
    head = (f'<p class="quiet">{markup.text(title)} · model '
            f'{markup.text(contents.origin.model_file or "fitted for this report")} · '
            f'{markup.text(contents.origin.when)}</p>'
            f'<h1 class="verdict" id="verdict">{markup.text(verdict(contents))}</h1>')
    return _page(f'gravity_comp: {title}', head + f'<nav>{links}</nav>{body}',
                 f'{INLINE.render()}\n{script}\n<script>{_READY}</script>' if plots else '')


def message_html(title: str, message: str) -> str:
    """Return a page that says in words why there is nothing to show."""
    return _page(title, f'<h1 class="verdict" id="verdict">{markup.text(message)}</h1>', '')


def _section(section: Section, plots: str) -> str:
    drawn = f'<div class="plots">{plots}</div>' if plots else ''
    return (f'<section id="{section.key}"><h2>{markup.text(section.title)}</h2>{section.lead}'
            f'{drawn}{section.after}</section>\n')


def _page(title: str, body: str, scripts: str) -> str:
    return (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f'<link rel="icon" href="data:,">\n'
            f'<title>{markup.text(title)}</title>\n<style>{css.PAGE}</style>\n{scripts}\n'
            f'</head><body><main>{body}</main></body></html>\n')
