"""The workbench in a browser: names with markup, narrow pages, recordings and processes."""

import re
import urllib.request

from bench.shared.browser import EVIL_BAG, expect, INJECT, LIVELY
from bench.shared.workbench_page import home, look, PATIENCE, served, VIEWS, workers
import pytest

# Width of the page, and buttons beyond the screen.
WIDE = """() => {
  const results = []
  const walk = (root) => {
    for (const element of root.querySelectorAll('*')) {
      const box = element.getBoundingClientRect()
      if (element.localName == 'button' && box.right > innerWidth + 1)
        results.push(element.textContent)
      if (element.shadowRoot) walk(element.shadowRoot)
    }
  }
  walk(document)
  return [document.documentElement.scrollWidth, results]
}"""


def test_a_narrow_dark_page_fits_long_names_and_escapes_them(folder, watched):
    with served(folder, EVIL_BAG) as (address, _), \
            watched(home(address), color_scheme='dark') as tab:
        page = tab.page
        page.set_viewport_size({'width': 400, 'height': 860})
        tab.open(address)
        page.wait_for_selector('html.dark')
        page.get_by_role('button', name='Save the model').wait_for()
        add = page.get_by_role('button', name=re.compile('^Add coulomb_friction')).first
        add.click()
        page.locator('.fall').wait_for()
        page.locator('#idle').wait_for()
        for name in VIEWS:
            look(tab, name)
            width, out = page.evaluate(WIDE)
            assert width <= 400 and out == [], (name, width, out)
            assert all(wide < 400 for _, wide, _ in tab.plots()), name
            assert page.evaluate(LIVELY) == tab.views.evaluate(LIVELY) == [], name
        assert page.evaluate('typeof MathJax') == 'undefined'
        tab.picture('workbench-narrow')
        assert tab.dialogs == [] and tab.complaints == [] and tab.requests == []
        page.evaluate(INJECT)
        page.wait_for_timeout(200)
        assert tab.dialogs == [] and len(tab.complaints) == 3, tab.complaints
        assert all('Content Security Policy' in line for line in tab.complaints)


def test_work_continues_after_cancelling_and_a_recording_is_added(folder, server, watched):
    address = server[0]
    with watched(home(address)) as tab:
        page = tab.page
        tab.open(address)
        page.get_by_role('button', name='Cancel').click()
        page.locator('#trouble').filter(has_text='was cancelled').wait_for()
        expect(page.locator('#doing')).to_have_count(0)
        page.get_by_role('button', name='Try again').click()
        page.get_by_role('button', name='Save the model').wait_for()
        runs = page.locator('#side input[type=checkbox]')
        runs.nth(1).wait_for()
        page.locator('#idle').wait_for()
        count = runs.count()
        path = page.get_by_label('Path of another recording')
        for name, expected in (('run1.mcap', count + 1), ('other.mcap', count + 1)):
            path.fill(str(folder / name))
            page.get_by_role('button', name='Add it').click()
            if name == 'other.mcap':
                # A recording of another robot is refused, and the others are kept.
                page.locator('.warning').filter(has_text='not added').first.wait_for()
            else:
                page.get_by_text('run1.mcap', exact=True).nth(1).wait_for()
            expect(runs).to_have_count(expected)
            expect(runs.nth(2)).to_be_checked()
            page.locator('#idle').filter(has_text=re.compile('.')).wait_for()
        assert tab.complaints == []


def test_the_work_is_open_in_several_windows(server, watched):
    address = server[0]
    with watched(home(address)) as tab, watched(home(address)) as other:
        tab.open(address)
        # The job continues after a reload and in another window.
        tab.page.reload()
        tab.page.get_by_role('button', name='Add coulomb_friction:shoulder').wait_for()
        other.open(address)
        other.page.get_by_role('button', name='Add coulomb_friction:shoulder').wait_for()
        tab.page.get_by_role('button', name='Add coulomb_friction:shoulder').wait_for()
        # Nothing is shown without the token.
        with pytest.raises(urllib.request.HTTPError, match='403'):
            urllib.request.urlopen(home(address), timeout=PATIENCE)
        assert tab.complaints == [] and other.complaints == []


def test_a_request_for_the_page_starts_no_process(server):
    address, process = server
    before = workers(process.pid)
    for _ in range(10):
        assert urllib.request.urlopen(address, timeout=PATIENCE).status == 200
    # The process of a closed page may have ended meanwhile.
    assert set(workers(process.pid)) <= set(before)


def test_without_javascript_the_page_shows_a_message(server, watched):
    with watched(home(server[0]), java_script_enabled=False) as tab:
        tab.page.goto(server[0])
        assert 'requires JavaScript' in tab.page.locator('noscript').first.inner_text()
