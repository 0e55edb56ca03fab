"""What is on the bench, and the process that does the long work, without a browser."""

import os
from pathlib import Path
import subprocess
import sys
import time

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.workbench.jobs import Add, Ask, Bench, Choice, chosen, Learn, Read, thinned
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.worker import Failed, Finished, Progressed, Worker
import numpy as np
import pytest
from rough_links import COULOMB, JOINTS, two_links

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 120.0
BOTH = ('coulomb_friction:shoulder', 'viscous_friction:shoulder')


@pytest.fixture(scope='module')
def paths(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    for number in (1, 2):
        write_bag(folder / f'run{number}.mcap', [joint_states(two_links(number))])
    return tuple(folder / f'run{number}.mcap' for number in (1, 2))


def silent(stage, share):
    """Tell nobody."""


def do_next(session, bench):
    """Do what the session needs next, and tell it the answer."""
    job = session.next_job()
    answer = bench.work(job, silent)
    (session.learned if isinstance(job, Learn) else session.diagnosed)(answer)


def test_the_loop_add_sees_the_error_fall_and_undo_brings_it_back(paths):
    bench, session = Bench(), Session(paths)
    assert session.next_job() is None
    session.take(bench.work(Read(paths, ReadOptions()), silent))
    assert session.choice == Choice((0, 1), JOINTS)
    assert isinstance(session.next_job(), Learn)
    constant = session.preview()
    np.testing.assert_allclose(constant.predicted[0], session.samples.tau.mean(axis=0))
    do_next(session, bench)
    assert isinstance(session.next_job(), Ask)
    do_next(session, bench)
    assert session.next_job() is None
    targets = [target for _, target in session.findings()]
    assert 'coulomb_friction:shoulder' in targets
    before = session.contents()
    session.added(bench.work(session.adding(BOTH), silent))
    held = [stage.held_out['shoulder'] for stage in session.stages]
    assert held[1] < 0.5 * held[0]
    found = session.stage.model.applied.effects[0].coefficients['F_c'].value
    assert abs(found - COULOMB) < 0.1
    after = session.contents()
    assert after.comparison.joints['shoulder'].rmse < 0.5 * before.comparison.joints[
        'shoulder'].rmse == 0.5 * after.previous['shoulder']
    # What is in the model already cannot be added again, and a new diagnosis is due.
    assert session.findings() == [] and isinstance(session.next_job(), Ask)
    fit, add, report = session.commands()
    assert fit.startswith('gravity_comp fit ') and f' add {",".join(BOTH)} ' in add
    assert session.undo() == ', '.join(BOTH)
    assert not session.stage.model.applied.effects
    np.testing.assert_allclose(session.contents().predicted, before.predicted)
    assert [target for _, target in session.findings()] == targets
    with pytest.raises(DataError, match='no addition'):
        session.undo()


def test_choices_keep_or_drop_the_model(paths):
    bench, session = Bench(), Session(paths)
    session.take(bench.work(Read(paths, ReadOptions()), silent))
    do_next(session, bench)
    session.choose((0,), JOINTS, 'potential')
    assert session.stage is not None and session.samples.n_runs == 1
    session.choose((0,), ('elbow',), 'potential')
    assert session.stage is None and isinstance(session.next_job(), Learn)
    with pytest.raises(DataError, match='no run'):
        chosen(session.read.samples, Choice((), JOINTS))


def test_a_model_of_another_robot_is_refused_in_words(paths, tmp_path):
    other = tmp_path / 'other.mcap'
    write_bag(other, [joint_states(two_links(1, names=('a', 'b')))])
    bench = Bench()
    session = Session(paths)
    session.take(bench.work(Read(paths, ReadOptions()), silent))
    do_next(session, bench)
    stranger = Session((other,), models=(('arm.json', session.stage.model),))
    with pytest.raises(ModelMismatchError, match='arm.json is of another robot'):
        stranger.take(bench.work(Read((other,), ReadOptions()), silent))


def test_long_recordings_are_thinned_evenly_and_not_too_far():
    def run(count, rate):
        zero = np.zeros((count, 1))
        return JointSamples.single_run(('a',), np.arange(count) / rate, zero, zero, zero)

    assert thinned(run(30_000, 100.0)).n_samples == 30_000
    np.testing.assert_allclose(np.diff(thinned(run(60_000, 100.0)).t), 0.02)
    np.testing.assert_allclose(np.diff(thinned(run(360_000, 100.0)).t), 0.04)
    assert thinned(run(60_000, 20.0)).n_samples == 60_000


def until(worker, kind, patience=PATIENCE):
    """Return the first event of a kind."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        for event in worker.poll():
            if isinstance(event, kind):
                return event
        time.sleep(0.02)
    raise AssertionError(f'no {kind} within {patience} s')


def test_work_goes_on_aside_and_can_be_cancelled(paths):
    worker = Worker()
    try:
        started = time.monotonic()
        worker.ask(Read(paths, ReadOptions()))
        assert time.monotonic() - started < 1.0 and worker.busy
        read = until(worker, Finished).answer
        choice = Choice((0, 1), read.samples.names)
        worker.ask(Learn(choice, 'potential'))
        assert until(worker, (Progressed, Finished)) is not None
        started = time.monotonic()
        lost = worker.cancel()
        assert time.monotonic() - started < 6.0
        assert [event.cancelled for event in lost] in ([True], [])
        # The next job finds the recordings read again.
        worker.ask(Learn(choice, 'potential'))
        learned = until(worker, Finished)
        assert isinstance(learned.job, Learn) and learned.answer.model.joints == JOINTS
        worker.ask(Add(choice, learned.answer.model, ('torque_gain:nobody',)))
        failed = until(worker, Failed)
        assert 'nobody' in failed.reason and not failed.cancelled
    finally:
        worker.close()


def test_a_process_that_dies_is_replaced(paths):
    worker = Worker()
    try:
        worker.ask(Read(paths, ReadOptions()))
        until(worker, Finished)
        worker.ask(Learn(Choice((0, 1), JOINTS), 'potential'))
        worker._process.kill()
        assert 'ended' in until(worker, Failed).reason
        worker.ask(Learn(Choice((0,), JOINTS), 'potential'))
        assert until(worker, Finished).answer.model.joints == JOINTS
    finally:
        worker.close()


def test_the_work_ends_with_the_page_that_asked_for_it(paths):
    program = ('from gravity_comp_ros.workbench.worker import Worker\n'
               'import os\nif __name__ == "__main__":\n    worker = Worker()\n'
               '    print(worker._process.pid, flush=True)\n    os._exit(0)')
    script = paths[0].parent / 'leaves.py'
    script.write_text(program)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True,
                          timeout=PATIENCE, env={**os.environ, 'PYTHONPATH': str(ROOT)})
    pid = int(done.stdout)
    end = time.monotonic() + PATIENCE
    while _runs(pid):
        assert time.monotonic() < end, 'the worker outlives its page'
        time.sleep(0.05)


def _runs(pid):
    try:
        with open(f'/proc/{pid}/stat') as stream:
            return stream.read().rsplit(')', 1)[1].split()[0] != 'Z'
    except OSError:
        return False
