"""The workbench in a browser, with a server process and recordings."""

import base64
from contextlib import contextmanager
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
import urllib.request

from bench.shared.browser import expect, heap, INJECT, LIVELY, ROOT, SELECTED
from bench.shared.rough_links import COULOMB, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, JointTopic, write_bag
from gravity_comp_ros.recordings.trajectory_files import read_trajectory
import numpy as np
import pytest

pytestmark = pytest.mark.slow

PATIENCE = 240.0
RMSE = 'td:nth-of-type(2)'  # in the table of errors
# Heading of each view, and its number of plots for one joint.
VIEWS = {'Errors': ('Errors by joint', 0), 'Over time': ('Over time', 2),
         'Residual': ('Residual against speed, position, load and time', 4),
         'Pairs': ('Pairs of joints', 2), 'Spectrum': ('Spectrum of the residual', 2),
         'Effects': ('Missing effects', 1), 'Model': ('The model', 1),
         'Data': ('Quality of the data', 0), 'Provenance': ('Provenance', 0),
         'Two models': ('2. + coulomb_friction:shoulder against 1. gravity', 3),
         'Summary': ('Error of each joint', 2)}
LINK = r'\href{javascript:alert(3)}{\text{x}}'
EVIL = (f'<img src=x onerror=alert(1)> $${LINK}$$ $$${LINK}$$$',
        rf'</script><script>alert(2)</script> \[{LINK}\] \({LINK}\)')
EVIL_BAG = f'<b onclick=alert(4)> $${LINK}$$.mcap'


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
    write_bag(folder / EVIL_BAG, [joint_states(two_links(1, 600, names=EVIL),
                                               f'/$${LINK}$$<img src=x>')])
    return folder


@pytest.fixture(scope='module')
def server(folder):
    """Return address and process of a workbench for two recordings."""
    with served(folder, 'run1.mcap', 'run2.mcap') as address_and_process:
        yield address_and_process


@contextmanager
def served(folder, *argv):
    """Yield the address of a workbench, and its process."""
    log = (folder / 'workbench.log').open('w+')
    process = subprocess.Popen(
        [sys.executable, '-m', 'gravity_comp_ros.cli', 'workbench', *argv, '--port', '0',
         '--no-browser'], cwd=folder, stdout=subprocess.PIPE, stderr=log, text=True,
        env={**os.environ, 'PYTHONPATH': str(ROOT), 'XDG_STATE_HOME': str(folder / 'state')})
    try:
        line = process.stdout.readline()
        address = re.search(r'http://127\.0\.0\.1:\d+/\?token=\S+', line)
        log.seek(0)
        assert address, line + log.read()
        yield address[0], process
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
        log.seek(0)
        assert 'Traceback' not in (logged := log.read()), logged
    finally:
        process.kill()
        process.wait(PATIENCE)
        process.stdout.close()
        log.close()


def home(address):
    """Return the prefix of the server's own addresses."""
    return address.split('?')[0]


def test_the_loop_in_a_browser(server, watched, tmp_path):
    address = server[0]
    with watched(home(address), color_scheme='light') as tab:
        page = tab.page
        tab.open(address)
        add = page.get_by_role('button', name='Add coulomb_friction:shoulder')
        add.wait_for()
        verdict = page.locator('#verdict')
        expect(verdict).to_contain_text('Missing: Coulomb friction on joint shoulder')
        # The first view has bars, the evidence plot and the next command.
        tab.wait_for_plots(2)
        expect(page.locator('.command pre')).to_contain_text(
            'gravity_comp add coulomb_friction:shoulder')
        tab.picture('workbench')
        _look(tab, 'Errors')
        rmse_before = _rmse(page, 'shoulder')
        expect(verdict).to_contain_text(f'shoulder: {rmse_before} N·m RMSE')
        # By keyboard only.
        add.focus()
        page.keyboard.press('Enter')
        fall = page.locator('.fall')
        fall.wait_for()
        # The history, the table and the sentence show the same errors.
        before, after = re.findall(r'\d+\.\d+', fall.inner_text())
        assert before == rmse_before and float(after) < 0.5 * float(before)
        expect(_row(page, 'shoulder').locator(RMSE)).to_have_text(after)
        expect(page.locator('#applied')).to_contain_text('coulomb_friction:shoulder')
        page.locator('#idle').wait_for()
        # The focus of a screen reader is on the result.
        page.wait_for_function("document.activeElement.id == 'head'")
        for name in VIEWS:
            _look(tab, name)
        _compare_both_joints(tab)
        # Removed views do not stay in memory.
        used = heap(page)
        for name in 4 * ('Errors', 'Over time', 'Data', 'Residual', 'Summary'):
            _look(tab, name)
        assert heap(page) < used + 8.0
        _look(tab, 'Over time')
        tab.drag(page.locator('#views .bk-Figure').first, 0.2, 0.5)
        page.wait_for_function(f'({SELECTED})() > 0')
        _look(tab, 'Residual')
        assert 20 < tab.selected() < 1200
        _check_exports(page, tmp_path)
        page.get_by_role('button', name='Undo + coulomb_friction:shoulder').click()
        add.wait_for()
        _look(tab, 'Errors')
        expect(_row(page, 'shoulder').locator(RMSE)).to_have_text(rmse_before)
        expect(page.locator('#applied')).to_have_count(0)
        page.get_by_label('Name of this stage').fill('bare')
        page.get_by_label('Name of this stage').press('Enter')
        page.get_by_role('button', name='Dark or light').click()
        page.wait_for_selector('html.dark')
        tab.picture('workbench-dark')
        # A reload restores the session: both stages, with the first one selected.
        page.reload()
        add.wait_for()
        stages = page.get_by_label('Stage', exact=True)
        expect(stages.locator('option')).to_have_text([
            '1. bare', '2. + coulomb_friction:shoulder (undone)'])
        stages.select_option(label='2. + coulomb_friction:shoulder (undone)')
        expect(page.locator('#applied')).to_contain_text('coulomb_friction:shoulder')
        assert tab.complaints == [] and tab.requests == [] and tab.dialogs == []


def _compare_both_joints(tab):
    """Show the residuals of all joints with both models."""
    page = tab.page
    _look(tab, 'Two models')
    row = page.get_by_role('row', name=re.compile('^coulomb_friction:shoulder '))
    expect(row).to_contain_text('not included')
    expect(row).to_contain_text('F_c')
    page.get_by_label('Plots of joint').select_option(label='all joints')
    tab.wait_for_plots(6)
    titles = [title for title, _, _ in tab.plots()]
    assert [t for t in titles if t.startswith(('A ', 'B '))] == [
        'A shoulder', 'B shoulder', 'A elbow', 'B elbow']


def _check_exports(page, folder):
    saved = _saved(page, 'Save the model', folder / 'saved.json')
    effect = load_model(saved).applied.effects[0]
    # Viscous friction is not modelled yet, so Coulomb friction absorbs part of it.
    assert effect.target == 'coulomb_friction:shoulder'
    assert effect.coefficients['F_c'].value == pytest.approx(COULOMB, abs=0.05)
    report = _saved(page, 'Save a report', folder / 'report.html').read_text()
    assert 'id="verdict"' in report and 'coulomb_friction' in report
    lines = _saved(page, 'Save command lines', folder / 'lines.sh').read_text()
    assert re.search('/run2.mcap --formulation .* --joints shoulder,elbow -o arm.json', lines)
    assert 'gravity_comp add coulomb_friction:shoulder --model arm.json' in lines


def test_a_session_persists_and_is_open_in_one_window(server, watched):
    address = server[0]
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
        links = other.page.locator('#earlier a')
        expect(links.first).to_have_text('run1.mcap, run2.mcap')
        links.first.click()
        other.page.get_by_role('button', name='Save the model').wait_for()
        assert 'session=' in other.page.url and other.page.url != name
        # Nothing is shown without the token.
        with pytest.raises(urllib.request.HTTPError, match='403'):
            urllib.request.urlopen(home(address), timeout=PATIENCE)
        assert tab.complaints == [] and other.complaints == []


def test_work_continues_after_cancelling_or_a_killed_process(server, watched):
    address, process = server
    with watched(home(address)) as tab:
        page = tab.page
        tab.open(address)
        again = page.get_by_role('button', name='Try again')
        # Twice, in any of reading, fitting and diagnosing.
        for _ in range(2):
            page.get_by_role('button', name='Cancel').click()
            page.locator('#trouble').filter(has_text='was cancelled').wait_for()
            expect(page.locator('#doing')).to_have_count(0)
            again.click()
        page.locator('#idle').wait_for()
        # A stopped process does not finish its job before it is killed. All of them, because the
        # process of this page is unknown.
        workers = _workers(process.pid)
        for worker in workers:
            os.kill(worker, signal.SIGSTOP)
        page.get_by_role('button', name='Fit with these settings').click()
        page.locator('#doing').filter(has_text='Learning gravity').wait_for()
        for worker in workers:
            os.kill(worker, signal.SIGKILL)
        page.locator('#trouble').filter(has_text='process').wait_for()
        again.click()
        page.get_by_label('Stage', exact=True).locator('option').nth(1).wait_for(state='attached')
        page.locator('#idle').wait_for()
        assert tab.complaints == []


def test_a_request_for_the_page_starts_no_process(server):
    address, process = server
    before = _workers(process.pid)
    for _ in range(10):
        assert urllib.request.urlopen(address, timeout=PATIENCE).status == 200
    # The process of a closed page may have ended meanwhile.
    assert set(_workers(process.pid)) <= set(before)


def _workers(pid):
    """Return the worker processes of a server."""
    workers = []
    for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split():
        if 'worker.serve' in Path(f'/proc/{child}/cmdline').read_text():
            workers.append(int(child))
    return workers


def _row(page, joint):
    return page.get_by_role('row', name=re.compile(f'^{joint} ')).first


def _rmse(page, joint):
    """Return the RMSE of a joint in the view of errors."""
    _row(page, joint).wait_for()
    return _row(page, joint).locator(RMSE).inner_text()


def _look(tab, name):
    """Open a view and wait until its plots are drawn."""
    title, at_least = VIEWS[name]
    tab.page.get_by_role('button', name=name, exact=True).click()
    tab.page.locator('#views').get_by_role('heading', name=title, exact=True).wait_for()
    tab.wait_for_plots(at_least)


def _saved(page, button, path):
    with page.expect_download() as download:
        page.get_by_role('button', name=button).click()
    download.value.save_as(path)
    return path


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
        page.get_by_label('Name of this stage').fill(EVIL[0])
        page.get_by_label('Name of this stage').press('Enter')
        add = page.get_by_role('button', name=re.compile('^Add coulomb_friction')).first
        end = time.monotonic() + 300.0
        while not page.locator('.fall').count():
            assert time.monotonic() < end
            # A click while the renamed stage is drawn again is lost.
            if page.locator('#idle').count() and add.is_visible():
                add.click()
            page.wait_for_timeout(500)
        page.locator('#idle').wait_for()
        for name in VIEWS:
            page.get_by_role('button', name=name, exact=True).click()
            page.locator('#views h2, #views p').first.wait_for()
            tab.wait_for_plots(VIEWS[name][1])
            width, out = page.evaluate(WIDE)
            assert width <= 400 and out == [], (name, width, out)
            assert all(wide < 400 for _, wide, _ in tab.plots()), name
            assert page.evaluate(LIVELY) == [], name
        assert page.evaluate('typeof MathJax') == 'undefined'
        tab.picture('workbench-narrow')
        assert tab.dialogs == [] and tab.complaints == [] and tab.requests == []
        page.evaluate(INJECT)
        page.wait_for_timeout(200)
        assert tab.dialogs == [] and len(tab.complaints) == 3, tab.complaints
        assert all('Content Security Policy' in line for line in tab.complaints)


@pytest.mark.campaign
def test_a_fast_recording_of_seven_described_joints(folder, watched, tmp_path):
    bag, urdf = folder / 'fast.mcap', ROOT / 'bags' / 'iiwa7.urdf'
    assert main(['synth', '--motion', 'multisine', '--max-speed', '1.0', '--rate', '50',
                 '--noise', '0.05', '--duration', '30', '--hidden',
                 'coulomb_friction:iiwa_joint_4=0.8', '-o', str(bag)]) == 0
    with served(folder, bag.name, '--urdf', str(urdf)) as (address, _), watched(
            home(address), color_scheme='light') as tab:
        page = tab.page
        tab.open(address)
        # All samples are fitted, with the axes of the description and a warning.
        page.locator('.warning').filter(
            has_text='samples are slow: all are fitted').first.wait_for()
        page.get_by_role('button', name=re.compile('^Add all')).wait_for()
        expect(page.get_by_label('Samples for fit and errors')).to_have_value('all samples')
        learned = load_model(_saved(page, 'Save the model', tmp_path / 'learned.json'))
        assert learned.geometry is not None and learned.provenance['description']['source'] == str(
            urdf)
        page.get_by_role('button', name='Arm', exact=True).click()
        page.locator('#views').get_by_role('heading', name='The arm', exact=True).wait_for()
        status = page.get_by_role('status').filter(has_text='iiwa_joint_1')
        status.filter(has_text='At 0.00 s').wait_for()
        page.get_by_role('slider').first.focus()
        page.keyboard.press('PageUp')
        status.filter(has_not_text='At 0.00 s').wait_for()
        # A new fit with another torque constant.
        page.get_by_role('button', name='Units and velocities').click()
        page.get_by_label('iiwa_joint_4', exact=True).last.fill('0.9')
        page.get_by_role('button', name='Fit with these settings').click()
        page.get_by_label('Stage', exact=True).locator('option').nth(1).wait_for(state='attached')
        scaled = load_model(_saved(page, 'Save the model', tmp_path / 'scaled.json'))
        assert scaled.provenance['bags'][0]['effort_scale'] == {'iiwa_joint_4': 0.9}
        assert tab.complaints == []


def test_a_motion_is_planned_for_an_open_finding(folder, watched, tmp_path):
    # Motion in one direction does not distinguish friction from an offset.
    write_bag(folder / 'one_way.mcap', [joint_states(two_links(1, one_way=True))])
    with served(folder, 'one_way.mcap') as (address, _), watched(home(address)) as tab:
        page = tab.page
        tab.open(address)
        ask = page.get_by_role('button', name='Plan a motion')
        ask.wait_for()
        page.locator('#idle').wait_for()
        choice = page.get_by_label('Next recording resolves')
        target = 'coulomb_friction:shoulder'
        choice.locator('option', has_text=target).first.wait_for(state='attached')
        choice.select_option(target)
        ask.click()
        page.locator('#planned').wait_for()
        row = page.get_by_role('row', name=re.compile(f'^{target} '))
        expect(row).to_contain_text('F_c ±')
        # The chances before and after the motion, which an alternative makes less than certain.
        before, after = map(int, re.findall(r'(\d+) %', row.inner_text())[:2])
        assert before == 0 and after >= 90
        expect(page.locator('p.warning').filter(has_text='Move the arm to')).to_contain_text(
            'keep the space around the arm clear')
        page.locator('#idle').wait_for()
        motion = read_trajectory(_saved(page, 'Save as trajectory', tmp_path / 'motion.yaml'))
        table = read_trajectory(_saved(page, 'Save as CSV', tmp_path / 'motion.csv'))
        assert motion.joints == table.joints == ('shoulder', 'elbow')
        assert np.ptp(motion.q[:, 0]) > 0.01 and abs(table.qd).max() < 0.301
        tab.picture('workbench-plan')
        # A plan is discarded with its model.
        page.get_by_role('button', name='Fit with these settings').click()
        page.locator('#planned').wait_for(state='detached')
        assert tab.complaints == []


def test_without_javascript_the_page_shows_a_message(server, watched):
    with watched(home(server[0]), java_script_enabled=False) as tab:
        tab.page.goto(server[0])
        assert 'requires JavaScript' in tab.page.locator('noscript').first.inner_text()


def test_an_unreadable_recording_is_reported(folder, watched):
    with served(folder, 'silent.mcap') as (address, _), watched(home(address)) as tab:
        tab.open(address)
        tab.page.locator('#words').filter(has_text='effort is missing, NaN').wait_for()
        assert tab.complaints == []


DROP = """([name, data]) => {
  const carried = new DataTransfer(), bytes = Uint8Array.from(atob(data), c => c.charCodeAt(0))
  carried.items.add(new File([bytes], name))
  document.body.dispatchEvent(new DragEvent('drop', {dataTransfer: carried, bubbles: true}))
}"""


def test_a_recording_is_uploaded_to_the_page(folder, server, watched):
    address = server[0]
    with watched(home(address)) as tab:
        page = tab.page
        tab.open(address)
        page.get_by_role('button', name='Save the model').wait_for()
        runs = page.locator('#side input[type=checkbox]')
        runs.nth(1).wait_for()
        page.locator('#idle').wait_for()
        count = runs.count()
        name = '../../<img src=x onerror=alert(1)> $$x$$.mcap'
        page.evaluate(DROP, [name, base64.b64encode(b'no recording').decode()])
        status_line = page.locator('#upload-status')
        status_line.filter(has_text='is not an MCAP or rosbag2 recording').wait_for()
        page.evaluate(DROP, ['empty.mcap', ''])
        status_line.filter(
            has_text='empty.mcap: the content is not an MCAP or rosbag2 recording').wait_for()
        page.evaluate(DROP, [name, base64.b64encode(
            (folder / 'run1.mcap').read_bytes()).decode()])
        status_line.filter(has_text='was uploaded').wait_for()
        page.get_by_text(re.compile('^[0-9a-f]{6}_img_src_x_onerror_alert_1_x.mcap$')).wait_for()
        expect(runs).to_have_count(count + 1)
        expect(runs.nth(2)).to_be_checked()
        # The name is not used as a path; the file is in the folder of its session.
        kept = list(folder.glob('state/gravity_comp/workbench/recordings/*/*'))
        assert [path.read_bytes() for path in kept] == [(folder / 'run1.mcap').read_bytes()]
        # A recording of another robot is refused, and the others are kept.
        page.locator('#upload').set_input_files(folder / 'other.mcap')
        refused = page.locator('#status, .warning').filter(has_text='not added').first
        refused.wait_for()
        assert str(folder) not in refused.inner_text()
        page.locator('#idle').filter(has_text=re.compile('.')).wait_for()
        expect(runs).to_have_count(count + 1)
        assert len(list(folder.glob('state/gravity_comp/workbench/recordings/*/*'))) == 1
        assert page.evaluate(LIVELY) == [] and tab.dialogs == []
        assert len(tab.complaints) == 2 and all('415' in line for line in tab.complaints)


@pytest.mark.parametrize('argv, message', [
    (['run1.mcap', '--model', 'none.json'], 'none.json'),
    (['run1.mcap', '--host', '256.1.1.1'], '--port'),
])
def test_wrong_usage_gives_one_line(folder, capsys, monkeypatch, argv, message):
    monkeypatch.chdir(folder)
    assert main(['workbench', *argv, '--port', '0', '--no-browser']) == 1
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1
