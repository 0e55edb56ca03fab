"""The workbench as people use it: a real browser, a real process, real recordings."""

from contextlib import contextmanager
import http.client
import os
import re
import signal
import subprocess
import sys
import time
import urllib.parse

from bokeh.util.token import generate_jwt_token, generate_session_id
from browser import PLOTS, ROOT, watched
from gravity_comp_ros.cli import main
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, JointTopic, write_bag
import numpy as np
import pytest
from rough_links import COULOMB, two_links

pytestmark = pytest.mark.slow

PATIENCE = 120.0
RMSE = 'td:nth-of-type(2)'  # in the table of errors
# Each view's heading, and how many plots it has at least, with the error so far.
VIEWS = {'Over time': ('Over time', 5), 'Residual': ('What the residual depends on', 9),
         'Pairs': ('Over pairs of joints', 3), 'Spectrum': ('How the residual repeats', 5),
         'Effects': ('What is missing', 1), 'Model': ('The model', 3),
         'Data': ('Quality of the data', 1), 'Origin': ('Where this comes from', 1),
         'Two models': ('+ coulomb_friction:shoulder (now) against gravity', 2)}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('workbench')
    for number in (1, 2):
        write_bag(folder / f'run{number}.mcap', [joint_states(two_links(number))])
    write_bag(folder / 'other.mcap', [joint_states(two_links(1, names=('a', 'b')))])
    samples = two_links(1)
    write_bag(folder / 'silent.mcap', [JointTopic(
        '/joint_states', samples.names, samples.t, samples.q, samples.qd,
        np.full_like(samples.tau, np.nan))])
    assert main(['fit', str(folder / 'run1.mcap'), '-o', str(folder / 'arm.json')]) == 0
    return folder


@contextmanager
def served(folder, *argv):
    """Yield the address of a workbench, and how long it took to be there."""
    started = time.monotonic()
    log = (folder / 'workbench.log').open('w+')
    process = subprocess.Popen(
        [sys.executable, '-m', 'gravity_comp_ros.cli', 'workbench', *argv, '--port', '0',
         '--no-browser'], cwd=folder, stdout=subprocess.PIPE, stderr=log, text=True,
        env={**os.environ, 'PYTHONPATH': str(ROOT)})
    try:
        line = process.stdout.readline()
        address = re.search(r'http://127\.0\.0\.1:\d+/', line)
        log.seek(0)
        assert address, line + log.read()
        yield address[0], time.monotonic() - started
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
        log.seek(0)
        assert 'Traceback' not in (told := log.read()), told
    finally:
        process.kill()
        process.wait(PATIENCE)
        process.stdout.close()
        log.close()


def test_the_loop_in_a_browser(folder, tmp_path):
    with served(folder, 'run1.mcap', 'run2.mcap') as (address, _), watched(address) as tab:
        page = tab.page
        tab.open(address)
        add = page.get_by_role('button', name='Add coulomb_friction:shoulder')
        add.wait_for()
        assert 'Coulomb friction' in page.locator('#verdict').inner_text()
        tab.picture('workbench')
        rmse_before = _rmse(page, 'shoulder')
        # Reached and pressed by keyboard alone.
        add.focus()
        started = time.monotonic()
        page.keyboard.press('Enter')
        page.locator('.fall').wait_for()
        seconds = time.monotonic() - started
        before, after = map(float, re.findall(r'\d+\.\d+', page.locator('.fall').inner_text()))
        assert after < 0.5 * before and seconds < 60.0
        _until_other_than(page, 'shoulder', rmse_before)
        assert _rmse(page, 'shoulder') < 0.5 * rmse_before
        assert 'coulomb_friction:shoulder' in page.locator('#held').inner_text()
        page.locator('#idle').wait_for()
        _look_at_all_views(tab)
        _select(tab)
        saved = _saved(page, 'Save the model', tmp_path / 'saved.json')
        effect = load_model(saved).applied.effects[0]
        # The viscous part is not in the model yet, so friction takes some of it.
        assert effect.target == 'coulomb_friction:shoulder'
        assert COULOMB < effect.coefficients['F_c'].value < 1.0
        report = _saved(page, 'Save a report', tmp_path / 'report.html').read_text()
        assert 'id="verdict"' in report and 'coulomb_friction' in report
        lines = _saved(page, 'Save command lines', tmp_path / 'lines.sh').read_text()
        assert 'gravity_comp fit run1.mcap run2.mcap --formulation potential' in lines
        assert 'gravity_comp add coulomb_friction:shoulder --model arm.json' in lines
        page.get_by_role('button', name='Undo the last addition').click()
        add.wait_for()
        page.get_by_role('button', name='Errors', exact=True).click()
        assert _rmse(page, 'shoulder') == pytest.approx(rmse_before, rel=1e-3)
        assert page.locator('#held').count() == 0
        page.get_by_role('button', name='Dark').click()
        page.get_by_role('button', name='Light').wait_for()
        tab.picture('workbench-dark')
        assert tab.complaints == [] and tab.requests == [] and tab.dialogs == []


def _row(page, joint):
    return page.get_by_role('row', name=re.compile(f'^{joint} '))


def _until_other_than(page, joint, rmse):
    """Wait for the view of the new model: the panels of a page are drawn one by one."""
    old = page.locator(f'{RMSE} >> text={rmse:.4f}')
    _row(page, joint).filter(has_not=old).first.wait_for()


def _rmse(page, joint):
    """Return the RMSE of a joint in the view of errors."""
    row = _row(page, joint).first
    row.wait_for()
    return float(row.locator(RMSE).inner_text())


def _look_at_all_views(tab):
    for name, (title, at_least) in VIEWS.items():
        _show(tab, name)
        tab.picture(f'workbench-{name.replace(" ", "-").lower()}')
        assert len(tab.plots()) >= at_least, title


def _show(tab, name):
    """Open a view and wait until its plots are drawn; the error so far is one more."""
    title, at_least = VIEWS[name]
    tab.page.get_by_role('button', name=name, exact=True).click()
    tab.page.locator('#views').get_by_role('heading', name=title, exact=True).wait_for()
    tab.page.wait_for_function(
        f'(n) => {{ const p = ({PLOTS})(); return p.length >= n && p.every(x => x[1] > 60) }}',
        arg=at_least)


def _select(tab):
    """Select in one view; the selection is there in another."""
    page = tab.page
    _show(tab, 'Over time')
    plot = page.locator('#views .bk-Figure').first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.move(box['x'] + 150, box['y'] + 35)
    page.mouse.down()
    page.mouse.move(box['x'] + 400, box['y'] + 120, steps=4)
    page.mouse.up()
    _show(tab, 'Residual')
    assert 20 < tab.selected()[0] < 1200


def _saved(page, button, path):
    with page.expect_download() as download:
        page.get_by_role('button', name=button).click()
    download.value.save_as(path)
    return path


@pytest.mark.parametrize('argv, words', [
    (['silent.mcap'], 'effort is missing, NaN'),
    (['other.mcap', '--model', 'arm.json'], 'another robot'),
])
def test_what_cannot_be_shown_is_said_in_words(folder, argv, words):
    with served(folder, *argv) as (address, _), watched(address) as tab:
        tab.open(address)
        place = tab.page.locator('#words')
        place.filter(has_text=words).wait_for()
        tab.picture(f'workbench-{argv[0].split(".")[0]}')
        assert tab.complaints == []


def test_other_sites_cannot_talk_to_it(folder):
    with served(folder, 'run1.mcap') as (address, _):
        place = urllib.parse.urlsplit(address)
        token = generate_jwt_token(generate_session_id())
        for origin, status in (('http://evil.example', 403), (address.rstrip('/'), 101)):
            asking = http.client.HTTPConnection(place.hostname, place.port, timeout=PATIENCE)
            asking.request('GET', '/ws', headers={
                'Origin': origin, 'Upgrade': 'websocket', 'Connection': 'Upgrade',
                'Sec-WebSocket-Version': '13', 'Sec-WebSocket-Protocol': f'bokeh, {token}',
                'Sec-WebSocket-Key': 'dGhlIHNhbXBsZSBub25jZQ=='})
            assert asking.getresponse().status == status
            asking.close()


@pytest.mark.parametrize('argv, words', [
    ([], 'name at least one recording'), (['run1.mcap', '--model', 'none.json'], 'none.json'),
    (['run1.mcap', '--host', '256.1.1.1'], '--port'),
])
def test_wrong_calls_end_with_one_line(folder, capsys, monkeypatch, argv, words):
    monkeypatch.chdir(folder)
    assert main(['workbench', *argv, '--port', '0', '--no-browser']) == 1
    told = capsys.readouterr().err
    assert words in told and told.count('\n') == 1
