"""The speed-ups of Bokeh in a report reduce its work without changing the picture."""

import io

from bench.shared.browser import browsing
from bench.shared.rough_links import two_links
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.evaluation.compare import compare
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, Origin
from gravity_comp_ros.report.page import report_html
import numpy as np
from PIL import Image
import pytest

pytestmark = pytest.mark.slow

# For every plot: the number of paints, and whether it is within the first screen.
PAINTED = """() => {
  const counts = []
  const walk = (view) => {
    if (view.model.type == 'Figure')
      counts.push([view._render_count, view.el.getBoundingClientRect().top < innerHeight])
    for (const child of view.child_views || []) walk(child)
  }
  for (const view of Bokeh.index.roots) walk(view)
  return counts
}"""
# Number of own style sheets, of uses of shared sheets, and of shared sheets.
SHEETS = """() => {
  let own = 0, used = 0
  const all = new Set()
  const walk = (root) => {
    own += root.querySelectorAll('style').length
    for (const sheet of root.adoptedStyleSheets) {
      used += 1
      all.add(sheet)
    }
    for (const each of root.querySelectorAll('*')) if (each.shadowRoot) walk(each.shadowRoot)
  }
  for (const place of document.querySelectorAll('.plots'))
    for (const each of place.children) walk(each.shadowRoot)
  return [own, used, all.size]
}"""
# For every glyph of the shared table: rows found by a box around everything, rows with a position,
# and all rows.
FOUND = """() => {
  const counts = []
  const walk = (view) => {
    for (const each of view.renderer_views ? view.renderer_views.values() : []) {
      const {glyph} = each
      if (!glyph || !glyph.x || !each.model.data_source.get_column('q0')) continue
      const box = {x0: -1e9, x1: 1e9, y0: -1e9, y1: 1e9}
      let placed = 0
      for (const [k, x] of glyph.x.entries()) if (isFinite(x + glyph.y[k])) placed += 1
      counts.push([glyph.index.indices(box).count, placed, glyph.x.length])
    }
    for (const child of view.child_views || []) walk(child)
  }
  for (const view of Bokeh.index.roots) walk(view)
  return counts
}"""


@pytest.fixture(scope='module')
def watched():
    with browsing() as page:
        yield page


@pytest.fixture(scope='module')
def pages(tmp_path_factory):
    """Return a report of two runs, with and without the speed-ups of Bokeh."""
    samples = concatenate([two_links(1), two_links(2)])
    slow = slow_samples(samples).samples
    model = fit(slow, FitOptions('potential')).model
    html = report_html(Contents(samples, predict_torque(model, samples), model,
                                compare(model, slow), '', (), Origin('', '')))
    assert markup.LESS_WORK in html
    folder = tmp_path_factory.mktemp('drawing')
    fast, unmodified = folder / 'report.html', folder / 'unmodified.html'
    fast.write_text(html)
    unmodified.write_text(html.replace(markup.LESS_WORK, ''))
    return fast, unmodified


def test_every_plot_is_painted_once_without_scrolling(pages, watched):
    with watched(pages[0].as_uri()) as tab:
        tab.open(pages[0].as_uri())
        assert tab.page.evaluate('scrollY') == 0
        painted = tab.page.evaluate(PAINTED)
        assert [count for count, _ in painted] == [1] * len(painted)
        # Most plots are below the screen.
        assert len(painted) > 15 and sum(seen for _, seen in painted) < 5
        assert tab.complaints == []


def test_elements_share_their_style_sheets(pages, watched):
    with watched(pages[0].as_uri()) as tab:
        tab.open(pages[0].as_uri())
        own, used, sheets = tab.page.evaluate(SHEETS)
        assert own == 0 and used > 3 * sheets


def test_a_box_around_everything_finds_all_points_and_no_breaks(pages, watched):
    with watched(pages[0].as_uri()) as tab:
        tab.open(pages[0].as_uri())
        plots = tab.page.evaluate(FOUND)
        assert len(plots) >= 8
        for rows, placed, length in plots:
            assert rows == placed < length


@pytest.mark.parametrize('width, scheme', [(1280, 'light'), (400, 'dark')])
def test_the_page_looks_the_same_without_the_speed_ups(pages, watched, width, scheme):
    drawings = []
    for page in pages:
        with watched(page.as_uri(), color_scheme=scheme) as tab:
            tab.page.set_viewport_size({'width': width, 'height': 860})
            tab.open(page.as_uri())
            tab.page.evaluate('document.fonts.ready')
            picture = tab.page.screenshot(full_page=True)
            drawings.append(np.asarray(Image.open(io.BytesIO(picture)).convert('RGB'), dtype=int))
    assert drawings[0].shape == drawings[1].shape
    # Only the antialiasing of small squares differs.
    assert np.abs(drawings[0] - drawings[1]).max() < 48
