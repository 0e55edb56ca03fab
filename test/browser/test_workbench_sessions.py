"""The workbench in a browser: sessions, their processes, and pages without a result."""

import urllib.request

from bench.shared.browser import expect
from bench.shared.workbench_page import home, PATIENCE, workers
from bench.shared.workbench_session import session_of, worked
import pytest


def test_a_session_persists_and_is_open_in_one_window(folder, server, watched):
    address = server[0]
    paths = (folder / 'run2.mcap', folder / 'run1.mcap')
    worked(session_of(*paths, place=folder / 'state' / 'gravity_comp' / 'workbench'), 'DIAGNOSE')
    with watched(home(address)) as tab, watched(home(address)) as other:
        tab.open(address)
        tab.page.locator('#doing').wait_for()
        tab.page.wait_for_function("location.search.includes('session=')")
        name = tab.page.url
        # The job continues after a reload and in another window.
        tab.page.reload()
        tab.page.get_by_role('button', name='Add coulomb_friction:shoulder').wait_for()
        other.open(name)
        other.page.get_by_role('button', name='Add coulomb_friction:shoulder').wait_for()
        tab.page.locator('#taken').wait_for()
        other.page.locator('#earlier summary').click()
        other.page.locator('#earlier a').filter(has_text='run2.mcap, run1.mcap').click()
        other.page.get_by_role('button', name='Save the model').wait_for()
        assert 'session=' in other.page.url and other.page.url != name
        # Nothing is shown without the token.
        with pytest.raises(urllib.request.HTTPError, match='403'):
            urllib.request.urlopen(home(address), timeout=PATIENCE)
        assert tab.complaints == [] and other.complaints == []


def test_work_continues_after_cancelling(server, watched):
    address = server[0]
    with watched(home(address)) as tab:
        page = tab.page
        tab.open(address)
        again = page.get_by_role('button', name='Try again')
        page.get_by_role('button', name='Cancel').click()
        page.locator('#trouble').filter(has_text='was cancelled').wait_for()
        expect(page.locator('#doing')).to_have_count(0)
        again.click()
        page.locator('#idle').wait_for()
        assert tab.complaints == []


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
