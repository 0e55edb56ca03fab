"""Commands, notebook, workbench and fleet fit the same model to a recording."""

from dataclasses import replace
import json

from bench.shared.rough_links import two_links
from bench.shared.waisted_arm import IIWA, JOINTS, recording, WAISTED
from bench.shared.workbench_session import session_of, worked
import gravity_comp_ros as gc
from gravity_comp_ros.cli import main
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation import arms, motions
import numpy as np
import pytest


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with recordings whose joints are not in the order of the arm."""
    folder = tmp_path_factory.mktemp('same')
    q, arm = motions.eq17(duration=20.0).q, arms.iiwa7()
    (folder / 'robots' / 'one').mkdir(parents=True)
    recording(folder / 'robots' / 'one' / 'run', IIWA, arm, q,
              order=lambda names: tuple(reversed(JOINTS)))
    finger = ('finger', lambda n: 0.01 * (n % 2))
    recording(folder / 'gripper', WAISTED, arm, q, 0, [finger])
    return folder


def on_the_bench(path):
    """Return the workbench's session once it has learned a model."""
    return worked(session_of(path), until='DIAGNOSE')


def in_this_process(cluster, task, robots):
    """Yield the results of tasks of a fleet; test_fleet.py has a cluster."""
    for number, robot in enumerate(robots):
        try:
            yield number, task(robot), ''
        except DataError as problem:
            yield number, None, str(problem)


def poses():
    return np.random.default_rng(0).uniform(-1.0, 1.0, (50, len(JOINTS)))


def test_terminal_notebook_and_workbench_learn_the_same(folder, tmp_path, capsys):
    bag, file = folder / 'gripper', tmp_path / 'arm.json'
    assert main(['fit', str(bag), '-o', str(file), '--json']) == 0
    printed = json.loads(capsys.readouterr().out)
    fitted = load_model(file)
    assert fitted.joints == JOINTS and printed['report']['known_axes']
    data = gc.read(bag)
    assert data.joints == JOINTS
    notebook, session = gc.fit(data).gravity, on_the_bench(bag)
    assert session.stage.choice.joints == JOINTS == session.joints[:len(JOINTS)]
    assert session.stage.model.geometry.source == f'/robot_description in {bag.name}'
    for other in (notebook, session.stage.model):
        assert other.joints == JOINTS
        np.testing.assert_array_equal(other.predict(poses()), fitted.predict(poses()))
    # The command line shown on the page gives the same model.
    again = session.commands()[0].replace('arm.json', str(file))
    assert main(again.split()[1:]) == 0
    np.testing.assert_array_equal(load_model(file).predict(poses()), fitted.predict(poses()))


def test_a_fleet_learns_the_same(folder, tmp_path, capsys, monkeypatch):
    pytest.importorskip('distributed')
    monkeypatch.setattr('gravity_comp_ros.fleet.run.run_tasks', in_this_process)
    assert main(['fleet', 'fit', str(folder / 'robots'), '-o', str(tmp_path)]) == 0
    assert main(['fit', str(folder / 'robots' / 'one' / 'run'), '-o',
                 str(tmp_path / 'single.json')]) == 0
    capsys.readouterr()
    model, single = (load_model(tmp_path / name) for name in ('one.json', 'single.json'))
    assert model.joints == JOINTS and model.geometry is not None
    np.testing.assert_array_equal(model.predict(poses()), single.predict(poses()))


def test_the_same_recording_is_refused_with_the_same_error(tmp_path, capsys, monkeypatch):
    pytest.importorskip('distributed')
    monkeypatch.setattr('gravity_comp_ros.fleet.run.run_tasks', in_this_process)
    (tmp_path / 'robots' / 'one').mkdir(parents=True)
    bag, samples = tmp_path / 'robots' / 'one' / 'run.mcap', two_links(2)
    write_bag(bag, [joint_states(replace(samples, tau=samples.tau * [1, 4]))])
    assert main(['fit', str(bag)]) == 1
    error = capsys.readouterr().err
    assert 'gains disagree: ' in error
    with pytest.raises(DataError) as refusal:
        gc.fit(gc.read(bag))
    assert str(refusal.value) in error
    with pytest.raises(DataError) as refusal:
        gc.diagnose(gc.read(bag))
    assert str(refusal.value) in error
    assert worked(session_of(bag), until='LEARN').error in error
    assert main(['fleet', 'fit', str(bag.parents[1]), '-o', str(tmp_path / 'out')]) == 1
    assert str(refusal.value) in capsys.readouterr().err
    # A model of another driver, and a recording that is accepted.
    model = gc.fit(gc.read(bag, effort_scale={samples.names[1]: 0.25}))
    with pytest.raises(DataError, match='gains disagree'):
        gc.add_effects(model, gc.read(bag), ['coulomb_friction'])
    with pytest.raises(DataError, match='gains disagree.* A payload changes no axis'):
        gc.update(model, gc.read(bag))
    assert gc.fit(gc.read(bag, accept=['effort_gain'])).joints == samples.names


def test_the_workbench_can_ignore_the_description(folder):
    # Of the last joints alone, as a fit without axes takes seconds.
    session = worked(session_of(folder / 'robots' / 'one' / 'run'), until='LEARN')
    session.learn(replace(session.choice, urdf='none', joints=JOINTS[5:]))
    worked(session, until='DIAGNOSE')
    assert session.stage.model.geometry is None
    assert ' --urdf none ' in session.commands()[0]
