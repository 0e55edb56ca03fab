"""A report draws its plots with little work, and just as Bokeh alone would."""

import io

from browser import browsing
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.evaluation.compare import compare
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, Origin
from gravity_comp_ros.report.page import report_html
import numpy as np
from PIL import Image
import pytest
from rough_links import two_links

pytestmark = pytest.mark.slow

# Every plot of the page: how often it was painted, and whether it is within the first screen.
PAINTED = """() => {
  const found = []
  const walk = (view) => {
    if (view.model.type == 'Figure')
      found.push([view._render_count, view.el.getBoundingClientRect().top < innerHeight])
    for (const child of view.child_views || []) walk(child)
  }
  for (const view of Bokeh.index.roots) walk(view)
  return found
}"""
# Style sheets of elements: how many are their own, how many are shared, how many texts there are.
SHEETS = """() => {
  let own = 0, worn = 0
  const all = new Set()
  const walk = (root) => {
    own += root.querySelectorAll('style').length
    for (const sheet of root.adoptedStyleSheets) {
      worn += 1
      all.add(sheet)
    }
    for (const each of root.querySelectorAll('*')) if (each.shadowRoot) walk(each.shadowRoot)
  }
  for (const place of document.querySelectorAll('.plots'))
    for (const each of place.children) walk(each.shadowRoot)
  return [own, worn, all.size]
}"""
# Of every glyph of the table that plots share: rows that a box around everything finds, and rows
# that have a place.
FOUND = """() => {
  const found = []
  const walk = (view) => {
    for (const each of view.renderer_views ? view.renderer_views.values() : []) {
      const {glyph} = each
      if (!glyph || !glyph.x || !each.model.data_source.get_column('q0')) continue
      const box = {x0: -1e9, x1: 1e9, y0: -1e9, y1: 1e9}
      let placed = 0
      for (const [k, x] of glyph.x.entries()) if (isFinite(x + glyph.y[k])) placed += 1
      found.push([glyph.index.indices(box).count, placed, glyph.x.length])
    }
    for (const child of view.child_views || []) walk(child)
  }
  for (const view of Bokeh.index.roots) walk(view)
  return found
}"""


@pytest.fixture(scope='module')
def watched():
    with browsing() as page:
        yield page


@pytest.fixture(scope='module')
def pages(tmp_path_factory):
    """Return a report of two runs, and the same one as Bokeh alone draws it."""
    samples = concatenate([two_links(1), two_links(2)])
    slow = slow_samples(samples).samples
    model = fit(slow, FitOptions('potential')).model
    html = report_html(Contents(samples, predict_torque(model, samples), model,
                                compare(model, slow), '', (), Origin('', '')))
    assert markup.LESS_WORK in html
    folder = tmp_path_factory.mktemp('drawing')
    made, plain = folder / 'report.html', folder / 'plain.html'
    made.write_text(html)
    plain.write_text(html.replace(markup.LESS_WORK, ''))
    return made, plain


def test_every_plot_is_painted_once_without_scrolling(pages, watched):
    with watched(pages[0].as_uri()) as tab:
        tab.open(pages[0].as_uri())
        assert tab.page.evaluate('scrollY') == 0
        painted = tab.page.evaluate(PAINTED)
        assert [count for count, _ in painted] == [1] * len(painted)
        # Most of them are below the screen.
        assert len(painted) > 15 and sum(seen for _, seen in painted) < 5
        assert tab.complaints == []


def test_elements_share_their_style_sheets(pages, watched):
    with watched(pages[0].as_uri()) as tab:
        tab.open(pages[0].as_uri())
        own, worn, sheets = tab.page.evaluate(SHEETS)
        assert own == 0 and worn > 3 * sheets


def test_a_box_around_everything_finds_all_that_is_drawn_and_no_breaks(pages, watched):
    with watched(pages[0].as_uri()) as tab:
        tab.open(pages[0].as_uri())
        found = tab.page.evaluate(FOUND)
        assert len(found) >= 8
        for rows, placed, length in found:
            assert rows == placed < length


@pytest.mark.parametrize('width, scheme', [(1280, 'light'), (400, 'dark')])
def test_the_page_looks_as_bokeh_alone_would_draw_it(pages, watched, width, scheme):
    shown = []
    for page in pages:
        with watched(page.as_uri(), color_scheme=scheme) as tab:
            tab.page.set_viewport_size({'width': width, 'height': 860})
            tab.open(page.as_uri())
            tab.page.evaluate('document.fonts.ready')
            picture = tab.page.screenshot(full_page=True)
            shown.append(np.asarray(Image.open(io.BytesIO(picture)).convert('RGB'), dtype=int))
    assert shown[0].shape == shown[1].shape
    # Only the edges of small squares are smoothed by a shade more or less.
    assert np.abs(shown[0] - shown[1]).max() < 48
