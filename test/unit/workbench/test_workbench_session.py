"""Sessions of the workbench, without a browser."""

import contextlib
from copy import deepcopy
from dataclasses import replace
import html
import json
import os
from pathlib import Path
import re
import shlex
import signal
import time

from bench.shared.campaign import campaign
from bench.shared.rough_links import COULOMB, JOINTS, two_links
from bench.shared.workbench_session import session_of, worked
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.models.model_file import model_text
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.report.views.summary import headline
from gravity_comp_ros.workbench.jobs import Job, new_worker, Step
from gravity_comp_ros.workbench.page import facts_html, status_html
from gravity_comp_ros.workbench.panels import findings_html
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.settings import choice_of, form_html
from gravity_comp_ros.workbench.stages import Choice, Stage
from gravity_comp_ros.worker.worker_process import Done, Failed
import numpy as np
import pytest

PATIENCE = 240.0
BOTH = ('coulomb_friction:shoulder', 'viscous_friction:shoulder')


@pytest.fixture(scope='module')
def paths(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    for number in (1, 2):
        write_bag(folder / f'run{number}.mcap', [joint_states(two_links(number))])
    return tuple(folder / f'run{number}.mcap' for number in (1, 2))


@pytest.fixture(scope='module')
def first_read(paths):
    return worked(session_of(*paths), until='LEARN')


@pytest.fixture(scope='module')
def first_stage(first_read):
    return worked(deepcopy(first_read), until='DIAGNOSE')


@pytest.fixture
def learned(first_stage):
    """Return a session with a model of gravity, before its diagnosis."""
    return deepcopy(first_stage)


@pytest.fixture(scope='module')
def first_diagnosis(first_stage):
    return worked(deepcopy(first_stage))


@pytest.fixture
def diagnosed(first_diagnosis):
    """Return a session with a model of gravity and its diagnosis."""
    return deepcopy(first_diagnosis)


def test_joints_are_given_by_number(paths):
    reading = ReadOptions(joints=('2', '1'), effort_scale={'1': 2.0})
    session = worked(session_of(*paths, choice=Choice((), ('2', '1'), reading=reading)),
                     until='LEARN')
    assert session.worker.done == ['READ'] and session.is_read
    assert session.choice.joints == session.joints == ('elbow', 'shoulder')
    assert session.choice.reading.effort_scale == {'shoulder': 2.0}
    assert session.read.reports[0].effort_scale == {'shoulder': 2.0}


def test_add_reduces_the_error_and_undo_restores_it(first_read, diagnosed):
    results = Results(first_read)
    assert first_read.choice.runs == (0, 1) and first_read.choice.joints == JOINTS
    constant = results.contents()
    np.testing.assert_allclose(constant.predicted[0], results.recording.samples.tau.mean(axis=0))
    session, results = diagnosed, Results(diagnosed)
    assert session.worker.done == ['READ', 'LEARN', 'DIAGNOSE'] and not session.error
    targets = [targets for _, targets in results.findings()]
    assert ('coulomb_friction:shoulder',) in targets
    before = results.contents()
    # The sentence, the table and the history show one error.
    for name, joint in before.comparison.joints.items():
        assert results.errors(session.stage)[name] == joint.rmse
    assert f'shoulder: {before.error("shoulder")} N·m' in headline(before)
    session.add(BOTH)
    worked(session)
    coulomb = {effect.target: effect for effect in session.stage.model.applied.effects}[
        BOTH[0]].coefficients['F_c'].value
    assert abs(coulomb - COULOMB) < 0.1
    after = results.contents()
    assert after.comparison.joints['shoulder'].rmse < 0.5 * before.comparison.joints[
        'shoulder'].rmse == 0.5 * after.previous['shoulder']
    # Applied effects cannot be added again.
    assert all(not {*targets} & {*BOTH} for _, targets in results.findings())
    session.select_stage(0)
    assert not session.stage.model.applied.effects
    np.testing.assert_allclose(results.contents().predicted, before.predicted)
    assert [targets for _, targets in results.findings()] == targets
    # Redo, without another fit or diagnosis.
    done = list(session.worker.done)
    session.select_stage(1)
    assert worked(session).worker.done == done
    assert results.contents().comparison.joints['shoulder'].rmse == after.comparison.joints[
        'shoulder'].rmse


def test_the_button_of_a_finding_adds_what_diagnose_names(diagnosed):
    """An ambiguous effect whose size is not physical is replaced by its alternatives."""
    session, results = diagnosed, Results(diagnosed)
    finding = session.diagnosis.findings[0]

    def button_of(verdict, *to_add):
        changed = replace(finding, verdict=verdict, to_add=to_add)
        session.stages = (replace(session.stage, diagnosis=replace(
            session.diagnosis, findings=(changed,))),)
        return re.findall('data-act="add" data-value="([^"]*)"', findings_html(results))

    own = f'{finding.effect}:{finding.joint}'
    for to_add in ((own,), (own, 'torque_gain:elbow'), ('torque_gain:elbow',)):
        assert button_of('ambiguous', *to_add)[0] == ','.join(to_add)
    assert not any(map(button_of, ('ambiguous', 'untestable', 'weak')))


def test_a_step_after_undo_replaces_the_undone_stages(learned):
    session, results = learned, Results(learned)
    for effects in (BOTH, ('torque_offset:elbow',)):
        session.add(effects)
        worked(session, until='DIAGNOSE')
    assert [stage.name for stage in session.stages] == ['gravity', '+ ' + ', '.join(BOTH),
                                                        '+ torque_offset:elbow']
    session.select_stage(0)
    session.add(('torque_offset:elbow',))
    worked(session, until='DIAGNOSE')
    assert [stage.name for stage in session.stages] == ['gravity', '+ torque_offset:elbow']
    assert ' add torque_offset:elbow ' in session.commands()[1]
    assert BOTH[0] not in str(session.commands())
    # A new fit of one joint is another stage; going back reads the joints of the earlier one.
    session.learn(replace(session.choice, joints=('elbow',)))
    worked(session, until='DIAGNOSE')
    assert session.worker.done[-2:] == ['READ', 'LEARN']
    assert session.stage.model.joints == ('elbow',) and len(session.stages) == 3
    assert list(results.others()) == ['1. gravity', '2. + torque_offset:elbow']
    session.select_stage(1)
    with pytest.raises(DataError, match='being read'):
        results.contents()
    worked(session, until='DIAGNOSE')
    assert session.worker.done[-1] == 'READ'
    assert results.contents().model is session.stages[1].model
    assert results.contents().previous_name == '1. gravity'
    results.other = '3. gravity'
    assert results.contents().previous_name == '3. gravity'
    assert set(results.contents().previous) == {'elbow'}


def test_a_model_is_evaluated_on_other_runs_without_a_new_fit(learned):
    session, results = learned, Results(learned)
    model = session.stage.model
    session.evaluate(replace(session.choice, runs=(0,)))
    assert session.stage.model is model and results.recording.n_runs == 1
    assert session.worker.job.step is Step.DIAGNOSE
    session.evaluate(replace(session.choice, joints=('elbow',)))
    assert 'fit a model of the selected joints' in session.error
    with pytest.raises(DataError, match='no run'):
        Choice((), JOINTS).recording(session.read.samples, session.read.reports)


def test_the_form_of_a_choice_describes_it(learned):
    reading = replace(learned.choice.reading, effort_scale={'elbow': -0.5}, differentiate=True,
                      accept=('effort_unit',))
    for choice in (learned.choice, replace(learned.choice, gate=None, reading=reading),
                   replace(learned.choice, runs=(1,), known_axes=False, formulation='potential')):
        learned.choice = choice
        page, form = form_html(learned), {}
        for tag in re.findall('<input[^>]*>', page):
            name, value = (re.search(f' {key}="([^"]*)"', tag)[1] for key in ('name', 'value'))
            if 'checkbox' not in tag or ' checked' in tag:
                form.setdefault(name, []).append(value)
        for name, options in re.findall('<select id=[^>]* name="([^"]*)"[^>]*>(.*?)</sel', page):
            form[name] = re.findall('value="([^"]*)" selected', options)
        assert choice_of(learned, form) == choice
    with pytest.raises(OptionError, match='at least one run'):
        choice_of(learned, {**form, 'run': []})
    with pytest.raises(OptionError, match='the scale of the effort of elbow'):
        choice_of(learned, {**form, f'scale-{JOINTS.index("elbow")}': ['x']})


def test_a_motion_is_planned_without_a_description(learned):
    learned.evaluate(replace(learned.choice, known_axes=False))
    learned.request_plan(('torque_offset:elbow',))
    worked(learned, until='DIAGNOSE')
    assert not learned.error and learned.plan.trajectory.joints == JOINTS


def test_a_model_of_another_robot_is_refused(learned, tmp_path):
    other = tmp_path / 'other.mcap'
    write_bag(other, [joint_states(two_links(1, names=('a', 'b')))])
    given = (Stage('arm.json', learned.stage.model, given=Path('arm.json')),)
    stranger = worked(session_of(other, given=given))
    assert 'arm.json is of another robot' in stranger.error
    # An added recording of another robot is refused, and the others are kept.
    learned.add_recording(other)
    worked(learned, until='DIAGNOSE')
    assert learned.warning.startswith('not added: ') and other.exists()
    assert learned.error == '' and len(learned.paths) == 2


def test_fast_recordings_give_a_warning_and_all_samples_can_be_used(tmp_path):
    fast = tmp_path / 'fast.mcap'
    samples = two_links(1)
    write_bag(fast, [joint_states(replace(samples, t=samples.t / 8.0, qd=samples.qd * 8.0))])
    session = worked(session_of(fast), until='DIAGNOSE')
    results = Results(session)
    # As in `fit`, all samples are fitted, and the model is evaluated on the same samples.
    assert session.choice.gate is None
    assert 'samples: all are fitted' in results.slow_warning()
    contents = results.contents()
    assert contents.compared == '1200 samples used, including fast ones'
    assert contents.comparison.joints['elbow'].n == 1200
    assert '--all-samples' in session.commands()[0]
    session.evaluate(replace(session.choice, gate=GateOptions()))
    assert 'keeps only' in results.slow_warning()


def test_what_fit_refuses_is_refused_until_a_setting_corrects_or_accepts_it(tmp_path):
    path, samples = tmp_path / 'small.mcap', two_links(1)
    write_bag(path, [joint_states(replace(samples, tau=samples.tau / 1e4))])
    session = worked(session_of(path))
    assert session.error.startswith('small.mcap: no effort reaches 0.1 N·m')
    assert session.stage is None and '--effort-scale' in session.error
    assert 'class="warning">small.mcap: refused: no effort' in facts_html(session.read)
    read = session.choice.reading
    for change in ({'effort_scale': dict.fromkeys(JOINTS, 1e4)}, {'accept': ('effort_unit',)}):
        session.learn(replace(session.choice, reading=replace(read, **change)))
        worked(session, until='DIAGNOSE')
        assert not session.error and 'refused' not in facts_html(session.read)
    assert '--accept effort_unit' in session.commands()[0]


def test_a_description_that_cannot_be_read_is_reported(paths, tmp_path):
    session = worked(session_of(*paths, choice=Choice(urdf=tmp_path / 'none.urdf')))
    assert 'none.urdf: no such file' in session.error


_EFFECTS = ('coulomb_friction:shoulder', 'torque_offset:elbow', 'viscous_friction')


def a_random_choice(rng, session):
    runs = tuple(sorted(rng.permutation(2)[:rng.integers(1, 3)].tolist()))
    joints = tuple(rng.permutation(JOINTS).tolist())
    gate = {} if rng.random() < 0.5 else (
        {'gate': GateOptions(0.1)} if rng.random() < 0.5 else {'gate': None})
    scale = {} if rng.random() < 0.5 else {'elbow': -1.0 / 3.0}
    reading = replace(session.choice.reading, effort_scale=scale,
                      differentiate=bool(rng.random() < 0.5))
    return replace(session.choice, runs=runs, joints=joints, reading=reading, **gate)


@pytest.mark.parametrize('seed', [0, *campaign(1)])
def test_command_lines_reproduce_the_model_exactly(paths, tmp_path, capsys, seed):
    rng = np.random.default_rng(seed)
    folder = tmp_path / "a b's bags"
    folder.mkdir()
    bags = tuple(folder / path.name for path in paths)
    for path, bag in zip(paths, bags):
        bag.write_bytes(path.read_bytes())
    reading = ReadOptions('/joint_states' if seed % 2 else None, zero={'elbow': 0.1 / 3.0})
    session = worked(session_of(*bags, choice=Choice(reading=reading)), until='LEARN')
    results = Results(session)
    session.learn(a_random_choice(rng, session))
    worked(session, until='DIAGNOSE')
    for target in rng.permutation(_EFFECTS)[:rng.integers(1, 3)].tolist():
        session.add((target,))
        worked(session, until='DIAGNOSE')
        # A model with a larger error on its own data is refused, as by `add`.
        if not session.error and rng.random() < 0.3:
            session.select_stage(session.at - 1)
        session.evaluate(replace(session.choice, runs=a_random_choice(rng, session).runs))
    *makes, compare, _ = session.commands()
    with contextlib.chdir(tmp_path):
        for line in makes:
            program, *arguments = shlex.split(line)
            assert program == 'gravity_comp' and main(arguments) == 0, line
        same = json.loads(Path('arm.json').read_text())['model']
        assert main([*shlex.split(compare)[1:], '--json', 'errors.json']) == 0
    mine = json.loads(model_text(session.stage.model))['model']
    # Gravity, effects, noise, range and provenance are equal.
    for model in (same, mine):
        model.pop('history')
    assert same == mine and mine['provenance']['gate']['total'] > 0
    # The errors on the page equal those of `compare`.
    errors = json.loads((tmp_path / 'errors.json').read_text())['joints']
    for name, joint in results.contents().comparison.joints.items():
        assert (errors[name]['n'], errors[name]['rmse']) == (joint.n, joint.rmse)


def test_a_given_model_is_named_in_the_next_step(learned, tmp_path):
    file = tmp_path / 'mine.json'
    file.write_text(model_text(learned.stages[0].model))
    session = worked(session_of(*learned.paths, given=(Stage.of_file(file),)))
    assert session.stages[0].name == 'mine.json' and not session.to_learn
    command = shlex.split(Results(session).contents().next_command)
    assert command[1] == 'add' and command[command.index('--model') + 1] == str(file)


def test_warnings_of_a_model_are_shown_with_its_stage(tmp_path):
    # With 12 s the chain is uncertain away from its poses.
    path = tmp_path / 'short.mcap'
    write_bag(path, [joint_states(two_links(0, 240, reach=0.6))])
    session = worked(session_of(path), until='DIAGNOSE')
    uncertainty, = (text for text in session.stage.warnings
                    if 'away from the trained poses' in text)
    results = Results(session)
    assert uncertainty in html.unescape(status_html(results))
    session.add(('torque_drift:shoulder',))
    worked(session, until='DIAGNOSE')
    assert not session.error
    # An addition does not lift the warnings about the fit.
    ineffective, *of_fit = session.stage.warnings
    assert uncertainty in of_fit
    assert ineffective in html.unescape(status_html(results))
    assert 'too small for a finding' in ineffective
    session.select_stage(0)
    output = html.unescape(status_html(results))
    assert uncertainty in output and ineffective not in output


def until(worker, kind):
    """Return the first message of a kind."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for _, message in worker.poll():
            if isinstance(message, kind):
                return message
        time.sleep(0.02)
    raise AssertionError(f'no {kind} within {PATIENCE} s')


def test_jobs_run_in_a_process_that_can_be_cancelled_or_die(paths):
    worker = new_worker()
    try:
        worker.start(Job(Step.READ, paths, Choice()))
        names = until(worker, Done).answer.samples.names
        first = worker.pid
        choice = Choice((0, 1), names)
        worker.start(Job(Step.LEARN, paths, choice))
        worker.cancel()
        assert worker.job is None and worker.pid is None and worker.poll() == []
        # The next job starts a process, which reads the recordings again.
        worker.start(Job(Step.LEARN, paths, choice))
        model = until(worker, Done).answer.model
        assert worker.pid != first
        assert model.joints == JOINTS
        worker.start(Job(Step.ADD, paths, choice, model=model,
                         effects=('torque_gain:absent',)))
        assert 'absent' in until(worker, Failed).reason
        # Stopped before the job, which could otherwise finish before the process is killed.
        os.kill(worker.pid, signal.SIGSTOP)
        worker.start(Job(Step.LEARN, paths, choice))
        os.kill(worker.pid, signal.SIGKILL)
        assert 'died' in until(worker, Failed).reason
    finally:
        worker.rest()
