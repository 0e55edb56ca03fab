"""Sessions of the workbench and their worker processes, without a browser."""

import asyncio
import contextlib
from dataclasses import replace
import html
import json
import logging
import os
from pathlib import Path
import shlex
import signal
import subprocess
import sys
import time

from bench.shared.rough_links import COULOMB, JOINTS, two_links
from bench.shared.running_process import is_running
from bokeh.core.types import ID
from bokeh.document import Document
from bokeh.document.events import ModelChangedEvent
from bokeh.models import Range1d
from bokeh.protocol import Protocol
from bokeh.server.connection import ServerConnection
from bokeh.server.protocol_handler import ProtocolHandler
from bokeh.server.session import ServerSession
from gravity_comp_ros.cli import main
from gravity_comp_ros.errors import (
    DataError, FitError, GravityCompError, ModelMismatchError)
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.report.style import LIGHT
from gravity_comp_ros.workbench import store
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.history_panel import chart
from gravity_comp_ros.workbench.job_state import Failed, Finished
from gravity_comp_ros.workbench.jobs import Add, Diagnose, JobRunner, Learn, Read
from gravity_comp_ros.workbench.page_parts import status_html
from gravity_comp_ros.workbench.serve import is_of_an_open_page
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.session_state import GivenModel
from gravity_comp_ros.workbench.sessions import Sessions
from gravity_comp_ros.workbench.stages import Stage
from gravity_comp_ros.workbench.worker import Worker
from gravity_comp_ros.worker.messages import Progress
import numpy as np
import pytest
from tornado.ioloop import IOLoop

ROOT = Path(__file__).resolve().parents[3]
PATIENCE = 240.0
BOTH = ('coulomb_friction:shoulder', 'viscous_friction:shoulder')


@pytest.fixture(scope='module')
def paths(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    for number in (1, 2):
        write_bag(folder / f'run{number}.mcap', [joint_states(two_links(number))])
    return tuple(folder / f'run{number}.mcap' for number in (1, 2))


def silent(stage, share):
    """Ignore progress."""


def do_next(session, runner, job=None):
    """Run a job, by default the next one of the session, and pass it the answer."""
    job = job or session.next_job()
    answer = runner.work(job, silent)
    if isinstance(job, Read):
        session.accept_recordings(answer, job.options)
    elif isinstance(job, Learn):
        session.learned(answer, job.choice)
    elif isinstance(job, Diagnose):
        session.diagnosed(answer, job)
    else:
        session.added(answer, job)
    return job


@pytest.fixture
def learned(paths):
    """Return a session with a model of gravity, and its job runner."""
    runner, session = JobRunner(), Session(paths)
    do_next(session, runner)
    do_next(session, runner)
    return session, runner


def test_add_reduces_the_error_and_undo_restores_it(paths):
    runner, session = JobRunner(), Session(paths)
    assert isinstance(do_next(session, runner), Read)
    assert session.choice.runs == (0, 1) and session.choice.joints == JOINTS
    constant = session.preview()
    np.testing.assert_allclose(constant.predicted[0], session.recording.samples.tau.mean(axis=0))
    assert isinstance(do_next(session, runner), Learn)
    assert isinstance(do_next(session, runner), Diagnose)
    assert session.next_job() is None
    targets = [target for _, target in session.findings()]
    assert 'coulomb_friction:shoulder' in targets
    before = session.contents()
    do_next(session, runner, session.adding(BOTH))
    held = [stage.held_out['shoulder'] for stage in session.stages]
    assert held[1] < 0.5 * held[0]
    coulomb = session.stage.model.applied.effects[0].coefficients['F_c'].value
    assert abs(coulomb - COULOMB) < 0.1
    after = session.contents()
    assert after.comparison.joints['shoulder'].rmse < 0.5 * before.comparison.joints[
        'shoulder'].rmse == 0.5 * after.previous['shoulder']
    # Applied effects cannot be added again, and a new diagnosis is required.
    assert session.findings() == [] and isinstance(session.next_job(), Diagnose)
    assert session.undo() == ', '.join(BOTH)
    assert not session.stage.model.applied.effects
    np.testing.assert_allclose(session.contents().predicted, before.predicted)
    assert [target for _, target in session.findings()] == targets
    with pytest.raises(DataError, match='no addition'):
        session.undo()


def test_an_addition_to_an_earlier_stage_is_a_branch(learned):
    session, runner = learned
    do_next(session, runner, session.adding(BOTH))
    session.select_stage(0)
    do_next(session, runner, session.adding(('torque_offset:elbow',)))
    assert [stage.parent for stage in session.stages] == [None, 0, 0]
    assert ' add torque_offset:elbow ' in session.commands()[1] and BOTH[0] not in str(
        session.commands())
    session.describe(2, 'only the offset', 'after a talk')
    session.learn(replace(session.choice, joints=('elbow',)))
    assert isinstance(do_next(session, runner), Read)
    assert isinstance(do_next(session, runner), Learn)
    assert session.stage.model.joints == ('elbow',) and len(session.stages) == 4
    session.select_stage(2)
    # The joints of that stage are read again first.
    assert isinstance(do_next(session, runner), Read)
    assert session.contents().model is session.stages[2].model
    assert session.stage.name == 'only the offset'


def test_a_model_is_evaluated_on_other_runs_without_a_new_fit(learned):
    session, runner = learned
    model = session.stage.model
    session.evaluate(replace(session.choice, runs=(0,)))
    assert session.stage.model is model and session.recording.n_runs == 1
    assert isinstance(session.next_job(), Diagnose)
    with pytest.raises(DataError, match='fit a model of the selected joints'):
        session.evaluate(replace(session.choice, joints=('elbow',)))
    with pytest.raises(DataError, match='no run'):
        Choice((), JOINTS).recording(session.read.samples, session.read.reports)


def test_a_model_of_another_robot_is_refused(learned, tmp_path):
    other = tmp_path / 'other.mcap'
    write_bag(other, [joint_states(two_links(1, names=('a', 'b')))])
    stranger = Session((other,), given=(GivenModel(Path('arm.json'), learned[0].stage.model),))
    with pytest.raises(ModelMismatchError, match='arm.json is of another robot'):
        do_next(stranger, JobRunner())


def test_fast_recordings_give_a_warning_and_all_samples_can_be_used(paths, tmp_path):
    fast = tmp_path / 'fast.mcap'
    samples = two_links(1)
    write_bag(fast, [joint_states(replace(samples, t=samples.t / 8.0, qd=samples.qd * 8.0))])
    runner, session = JobRunner(), Session((fast,))
    do_next(session, runner)
    # As in `fit`, all samples are fitted, and the model is evaluated on the same samples.
    assert session.choice.all_samples
    assert 'samples are slow: all are fitted' in session.slow_warning()
    do_next(session, runner)
    contents = session.contents()
    assert contents.compared == '1200 samples used, including fast ones'
    assert '--all-samples' in session.commands()[0]
    session.evaluate(replace(session.choice, all_samples=False))
    assert 'fast motion' in session.slow_warning()
    session.evaluate(replace(session.choice, all_samples=True))
    assert contents.comparison.joints['elbow'].n == 1200


_EFFECTS = ('coulomb_friction:shoulder', 'torque_offset:elbow', 'viscous_friction')


def a_random_choice(rng, session):
    runs = tuple(sorted(rng.permutation(2)[:rng.integers(1, 3)].tolist()))
    joints = tuple(rng.permutation(JOINTS).tolist())
    gate = {} if rng.random() < 0.5 else (
        {'max_speed': 0.1} if rng.random() < 0.5 else {'all_samples': True})
    scale = {} if rng.random() < 0.5 else {'elbow': -1.0 / 3.0}
    return replace(session.choice, runs=runs, joints=joints, effort_scale=scale,
                   differentiate=bool(rng.random() < 0.5), **gate)


@pytest.mark.parametrize('seed', range(3))
def test_command_lines_reproduce_the_model_exactly(paths, tmp_path, capsys, seed):
    rng = np.random.default_rng(seed)
    folder = tmp_path / "a b's bags"
    folder.mkdir()
    bags = tuple(folder / path.name for path in paths)
    for path, bag in zip(paths, bags):
        bag.write_bytes(path.read_bytes())
    runner, session = JobRunner(), Session(bags, topic='/joint_states' if seed % 2 else None)
    do_next(session, runner)
    session.learn(a_random_choice(rng, session))
    while not isinstance(session.next_job(), Diagnose):
        do_next(session, runner)
    for target in rng.permutation(_EFFECTS)[:rng.integers(1, 4)].tolist():
        try:
            do_next(session, runner, session.adding((target,)))
        except FitError:
            continue  # a model with a larger error on its own data is refused, as by `add`
        if rng.random() < 0.3:
            session.undo()
        session.evaluate(replace(session.choice, runs=a_random_choice(rng, session).runs))
    *makes, compare, _ = session.commands()
    with contextlib.chdir(tmp_path):
        for line in makes:
            program, *arguments = shlex.split(line)
            assert program == 'gravity_comp' and main(arguments) == 0, line
        same = json.loads(Path('arm.json').read_text())['model']
        assert main([*shlex.split(compare)[1:], '--json', 'errors.json']) == 0
    mine = json.loads(store.model_text(session.stage.model))['model']
    # Gravity, effects, noise, range and provenance are equal.
    for model in (same, mine):
        model.get('applied', {}).pop('history', None)
    assert same == mine and mine['provenance']['gate']['total'] > 0
    # The errors on the page equal those of `compare`.
    errors = json.loads((tmp_path / 'errors.json').read_text())['joints']
    for name, joint in session.contents().comparison.joints.items():
        assert (errors[name]['n'], errors[name]['rmse']) == (joint.n, joint.rmse)


def test_a_saved_session_is_restored(learned, tmp_path):
    session, runner = learned
    do_next(session, runner, session.adding(BOTH))
    session.describe(1, 'with friction', 'looks right')
    place, name = tmp_path / 'state', '0123456789abcdef'
    store.save(place, name, session)
    assert (place / f'{name}.json').stat().st_mode & 0o077 == 0
    assert (place.stat().st_mode & 0o077) == 0
    loaded, hashes = store.load(place, name)
    assert loaded.paths == session.paths and loaded.choice == session.choice
    assert [s.name for s in loaded.stages] == ['gravity', 'with friction']
    assert loaded.commands() == session.commands()
    assert isinstance(do_next(loaded, JobRunner()), Read)
    assert store.changed_recordings(loaded, hashes) == []
    np.testing.assert_array_equal(loaded.contents().predicted, session.contents().predicted)
    assert isinstance(loaded.next_job(), Diagnose)
    saved, = store.listed(place)
    assert saved.recordings == ('run1.mcap', 'run2.mcap') and saved.stages[-1] == 'with friction'
    other = dict.fromkeys(hashes, 'f' * 64)
    assert store.changed_recordings(loaded, other) == ['run1.mcap', 'run2.mcap']


def test_warnings_of_a_model_are_shown_and_saved_with_its_stage(tmp_path):
    # With 20 s the chain is uncertain away from its poses.
    path, place = tmp_path / 'short.mcap', tmp_path / 'state'
    write_bag(path, [joint_states(two_links(1, 400))])
    sessions = Sessions(lambda: Session((path,)), place)
    try:
        one = sessions.attach('', object())
        polled(sessions, lambda: one.session.diagnosis is not None)
        uncertainty, = (text for text in one.session.stage.warnings
                        if 'away from the trained poses' in text)
        assert uncertainty in html.unescape(status_html(one))
        one.add(('torque_drift:elbow',))
        polled(sessions, lambda: one.error or (
            len(one.session.stages) == 2 and not one.worker.busy))
        assert not one.error
        ineffective, = one.session.stage.warnings
        assert ineffective in html.unescape(status_html(one))
        assert 'does not decrease significantly' in ineffective
        one.undo()
        output = html.unescape(status_html(one))
        assert uncertainty in output and ineffective not in output
    finally:
        sessions.close()
    loaded, _ = store.load(place, one.id)
    assert [stage.warnings for stage in loaded.stages] == [
        stage.warnings for stage in one.session.stages]


_DAMAGES = (
    lambda d: d.pop('stages'), lambda d: d.update(at=7), lambda d: d.update(version=2),
    lambda d: d['stages'][0].update(parent=0), lambda d: d['stages'][0].update(model='{}'),
    lambda d: d['choice'].update(runs=[9]), lambda d: d['choice'].update(surprise=1))


def test_a_damaged_session_is_refused_in_one_line(learned, tmp_path):
    name = '0123456789abcdef'
    path = tmp_path / f'{name}.json'
    store.save(tmp_path, name, learned[0])
    whole = path.read_text()
    for damage in _DAMAGES:
        document = json.loads(whole)
        damage(document)
        path.write_text(json.dumps(document))
        with pytest.raises(GravityCompError):
            store.load(tmp_path, name)
    path.write_text(whole[:1000])
    assert store.listed(tmp_path) == []
    for text in ('', '../../etc/passwd', 'f' * 16):
        with pytest.raises(DataError, match='session'):
            store.load(tmp_path, text)


def test_the_number_of_worker_processes_is_limited(paths, tmp_path):
    sessions = Sessions(lambda: Session(paths), tmp_path, max_processes=1)
    try:
        pages = object(), object()
        first = sessions.attach('', pages[0])
        second = sessions.attach('', pages[1])
        assert first.worker.alive and not second.worker.alive
        assert 'busy with another session' in second.error
        polled(sessions, lambda: first.session.read is not None)
        first.cancel()
        # The idle process of the first session ends; the session remains.
        second.try_again()
        assert second.worker.alive and not first.worker.alive
        polled(sessions, lambda: second.session.stage is not None)
        second.cancel()
        first.try_again()
        polled(sessions, lambda: first.session.stage is not None)
        # A page can attach an open session again; only one page has it at a time.
        again = object()
        assert sessions.attach(first.id, again) is first and first.page is again
        sessions.detach(pages[0])
        assert first.page is again
    finally:
        sessions.close()


def polled(sessions, done):
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end
        sessions.poll()
        time.sleep(0.02)


def until(worker, kind, patience=PATIENCE):
    """Return the first event of a kind."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        for event in worker.poll():
            if isinstance(event, kind):
                return event
        time.sleep(0.02)
    raise AssertionError(f'no {kind} within {patience} s')


def test_jobs_run_in_the_background_and_can_be_cancelled(paths):
    worker = Worker()
    try:
        worker.ask(Read(paths, ReadOptions()))
        assert worker.busy
        read = until(worker, Finished).answer
        choice = Choice((0, 1), read.samples.names)
        worker.ask(Learn(choice))
        assert until(worker, (Progress, Finished)) is not None
        lost = worker.cancel()
        assert [event.cancelled for event in lost] in ([True], [])
        # The next job reads the recordings again first.
        worker.ask(Learn(choice))
        learned = until(worker, Finished)
        assert isinstance(learned.job, Learn) and learned.answer.model.joints == JOINTS
        worker.ask(Add(choice, learned.answer.model, ('torque_gain:absent',)))
        failed = until(worker, Failed)
        assert 'absent' in failed.reason and not failed.cancelled
    finally:
        worker.close()


def test_a_process_that_dies_is_replaced(paths):
    worker = Worker()
    try:
        worker.ask(Read(paths, ReadOptions()))
        until(worker, Finished)
        # Stopped before the job, which could otherwise finish before the process is killed.
        os.kill(worker.pid, signal.SIGSTOP)
        worker.ask(Learn(Choice((0, 1), JOINTS)))
        os.kill(worker.pid, signal.SIGKILL)
        assert 'ended' in until(worker, Failed).reason
        worker.ask(Learn(Choice((0,), JOINTS)))
        assert until(worker, Finished).answer.model.joints == JOINTS
    finally:
        worker.close()


def test_the_worker_ends_with_its_parent_process(paths):
    program = ('from gravity_comp_ros.workbench.worker import Worker\n'
               'import os\nif __name__ == "__main__":\n    worker = Worker(warm=True)\n'
               '    print(worker.pid, flush=True)\n    os._exit(0)')
    script = paths[0].parent / 'leaves.py'
    script.write_text(program)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True,
                          timeout=PATIENCE, env={**os.environ, 'PYTHONPATH': str(ROOT)})
    pid = int(done.stdout)
    end = time.monotonic() + PATIENCE
    while is_running(pid):
        assert time.monotonic() < end, 'the worker outlives its parent'
        time.sleep(0.05)


def test_seven_joints_have_seven_colours_and_markers():
    names = tuple(f'joint_{n}' for n in range(7))
    model = GravityModel.from_energy(
        names, 'potential', Expansion(np.zeros(1, dtype=np.int64), np.zeros(1)), np.ones(7),
        Coverage(np.zeros(7), np.ones(7), 10, 1), {})
    stage = Stage('gravity', model, Choice(), held_out=dict.fromkeys(names, 0.1))
    lines = [(line.glyph.line_color, dot.glyph.marker) for line, dot in (
        item.renderers for item in chart([stage, stage], LIGHT).legend[0].items)]
    assert len({c for c, _ in lines}) == len({m for _, m in lines}) == len(lines) == 7


@pytest.mark.parametrize('is_open', [True, False])
def test_a_message_of_a_closed_page_logs_no_error(is_open, caplog, monkeypatch):
    # A workbench started by another test in this process has installed its filter.
    log = logging.getLogger('bokeh.server.protocol_handler')
    monkeypatch.setattr(log, 'filters', [])
    # Bokeh logs a traceback; other errors of a message are still logged.
    session = ServerSession(ID('page'), Document(), IOLoop(make_current=False))
    connection = ServerConnection(Protocol(), None, None, session)
    other, ends = Document(), Range1d()
    other.add_root(ends)
    # The model belongs to another document.
    message = Protocol().create('PATCH-DOC', [ModelChangedEvent(other, ends, 'end', 1.0)])
    if not is_open:
        connection.detach_session()
    asyncio.run(ProtocolHandler().handle(message, connection))
    (record,) = caplog.records
    assert record.name == log.name and record.exc_info
    assert is_of_an_open_page(record) == is_open
    assert is_of_an_open_page(logging.makeLogRecord({'msg': 'anything else'}))
