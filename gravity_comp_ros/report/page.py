"""The report as one self-contained HTML file."""

from __future__ import annotations

from dataclasses import fields
import json
import secrets

from bokeh.core.json_encoder import serialize_json
from bokeh.document import Document
from bokeh.resources import Resources
from gravity_comp_ros.report import css, markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.headline import headline
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.sections import SECTIONS
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import DARK, LIGHT

# The page loads nothing. Only scripts with the nonce of the page run, so that a name from a
# recording is never executed. Bokeh compiles its callbacks, which requires 'unsafe-eval'.
_POLICY = """default-src 'none'; base-uri 'none'; form-action 'none';
 script-src 'nonce-{nonce}' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:;
 font-src data:"""
# MathJax is omitted: it would turn \href in a joint's name into a link.
_COMPONENTS = ('bokeh', 'bokeh-widgets')
# Sections are drawn one after another, so that the first appears immediately and the page stays
# responsive. If the browser prefers dark pages, every colour of the light style is replaced by
# that of the dark style before anything is drawn. Print stays light.
_DRAW = """
const colours = new Map(COLOURS)
const dark_value = (value) => {
  if (typeof value == 'string') return colours.get(value) || value
  // Small values of a palette have the colour nearest to the background.
  if (Array.isArray(value) && value.length == 256) return [...value].reverse()
  if (Array.isArray(value) && value.every(each => typeof each == 'string'))
    return value.some(each => colours.has(each)) ? value.map(dark_value) : value
  if (value && Object.getPrototypeOf(value) == Object.prototype && colours.has(value.value))
    return {...value, value: dark_value(value.value)}
  return value
}
const darken = (plots) => {
  document.documentElement.classList.add('dark')
  for (const spot of document.querySelectorAll('.key i'))
    spot.style.background = dark_value(spot.getAttribute('style').replace('background:', ''))
  for (const model of plots._all_models.values())
    for (const name of Object.keys(model.properties)) {
      if (!/color|palette/.test(name)) continue
      const old = model[name], now = dark_value(old)
      if (now !== old) model[name] = now
    }
}
const {LayoutDOMView} = Bokeh.require('models/layouts/layout_dom')
const initialize = LayoutDOMView.prototype.lazy_initialize
const painted = () => new Promise(done => requestAnimationFrame(() => setTimeout(done)))
const pause = () => new Promise(done => setTimeout(done))
let sections = 0
LayoutDOMView.prototype.lazy_initialize = async function () {
  // The first section is painted before the others are drawn.
  if (this.parent == null) await (sections++ == 1 ? painted() : pause())
  await initialize.call(this)
}
window.addEventListener('load', async () => {
  const {Document} = Bokeh.require('document')
  const plots = Document.from_json(JSON.parse(document.getElementById('data').textContent))
  if (matchMedia('(prefers-color-scheme: dark)').matches) darken(plots)
  const places = [...document.querySelectorAll('.plots')]
  await Bokeh.embed.add_document_standalone(plots, document.body, places)
  // Everything is painted before the page is marked as ready.
  await painted()
  document.documentElement.dataset.ready = 'yes'
})
"""


def report_html(contents: Contents) -> str:
    """Return the page; it requires no network and no other file."""
    table = Table(contents)
    table.embed_fine_lines()
    # All plots share one table, so that selections are common.
    sections = [section for make in SECTIONS.values()
                if (section := make(contents, table, LIGHT))]
    document = Document()
    # Collect the models once, not once per section.
    with document.models.freeze():
        for section in sections:
            if section.plots is not None:
                document.add_root(section.plots)
    body = ''.join(map(_section, sections))
    links = ''.join(f'<a href="#{s.key}">{markup.text(s.title)}</a>' for s in sections)
    title = ', '.join(report.path.name for report in contents.reports) or 'recording'
    head = (f'<p class="quiet">{markup.text(title)} · model '
            f'{markup.text(contents.origin.model_file or "fitted for this report")} · '
            f'{markup.text(contents.origin.when)}</p>'
            f'<h1 class="verdict" id="verdict">'
            f'{markup.text(markup.units(headline(contents)))}</h1>')
    if document.roots:
        body += f'<script type="application/json" id="data">{_embedded(document)}</script>'
    draw = _DRAW.replace('COLOURS', _colour_pairs())
    bokeh = Resources(mode='inline', components=list(_COMPONENTS)).js_raw
    scripts = [*bokeh, markup.LESS_WORK, f'{{{draw}}}'] if document.roots else []
    return _page(f'gravity_comp: {title}', head + f'<nav>{links}</nav>{body}',
                 [*scripts, markup.COPY])


def message_html(title: str, message: str) -> str:
    """Return a page with an error message."""
    return _page(title, f'<h1 class="verdict" id="verdict">{markup.text(message)}</h1>', [])


def _colour_pairs() -> str:
    """Return pairs of light and dark colours as JSON."""
    return json.dumps([[getattr(LIGHT, field.name), getattr(DARK, field.name)]
                       for field in fields(LIGHT) if field.name != 'name'])


def _embedded(document: Document) -> str:
    """Return a document as JSON that is safe within a script element."""
    return serialize_json(document.to_json(deferred=False)).replace('<', '\\u003c')


def _section(section: Section) -> str:
    plots = '<div class="plots"></div>' if section.plots is not None else ''
    return (f'<section id="{section.key}"><h2>{markup.text(section.title)}</h2>{section.lead}'
            f'{plots}{section.after}</section>\n')


def _page(title: str, body: str, scripts: list[str]) -> str:
    nonce = secrets.token_urlsafe(16)
    run = '\n'.join(f'<script nonce="{nonce}">{script}</script>' for script in scripts)
    no_script = markup.paragraph('The plots require JavaScript, which is disabled in this '
                                 'browser. Tables and numbers are shown.')
    return (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="'
            f'{_POLICY.format(nonce=nonce)}">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f'<link rel="icon" href="data:,">\n'
            f'<title>{markup.text(title)}</title>\n<style>{css.PAGE}</style>\n{run}\n'
            f'</head><body><main>{"<noscript>" + no_script + "</noscript>" if scripts else ""}'
            f'{body}</main></body></html>\n')
