"""Motion that gravity needs; collisions of planned motion."""

from dataclasses import replace
import json

from bench.cases.arms import six_axis
from bench.shared.planning_arm import model, NAMES, one_way
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import FitError, GravityCompError, OptionError
from gravity_comp_ros.facts.fact import Kind
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.planning.collision import (
    arm_limits, CollisionsUnchecked, MARGIN, self_collision)
from gravity_comp_ros.planning.enough import enough_motion
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.planning.trajectory_files import read_trajectory
from gravity_comp_ros.planning.workspace import PlanOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

ARM = six_axis()
RATE = 10.0
CENTRE = np.array([0.2, -0.9, 0.8, -0.5, 0.7, 0.1])
PERIODS = np.array([61.0, 43.0, 29.0, 37.0, 53.0, 47.0])


def recorded(q):
    """Return samples along q (M, N) at 10 Hz, with friction and noise."""
    t = np.arange(len(q)) / RATE
    qd = np.gradient(q, t, axis=0)
    friction = np.array([2.0, 3.0, 2.0, 1.0, 0.8, 0.5])
    tau = gravity_torque(ARM, q) + friction * np.tanh(qd / 0.004)
    tau += 0.1 * np.random.default_rng(0).standard_normal(q.shape)
    return JointSamples.single_run(ARM.joints, t, q, qd, tau)


def sines(amplitude=0.7, seconds=180, periods=PERIODS):
    """Return poses (M, 6): sines of another period on each joint."""
    t = np.arange(int(seconds * RATE)) / RATE
    return CENTRE + amplitude * np.sin(2 * np.pi * t[:, None] / periods + np.arange(6))


def test_enough():
    enough = enough_motion(recorded(sines()))
    assert enough.facts() == [] and enough.seconds == 0
    assert enough.directions == enough.moving == 6
    assert enough.std == enough.after and max(enough.std.values()) < 0.05
    # A short recording is named with its duration.
    enough = enough_motion(recorded(sines(seconds=15)))
    assert len(enough.facts()) >= 1 and enough.seconds >= 15
    assert max(enough.std.values()) > 0.05


def test_a_joint_that_hardly_moves_is_named_with_a_motion_that_is_enough():
    amplitude = np.array([0.7, 0.04, 0.7, 0.7, 0.7, 0.7])
    first = recorded(sines(amplitude))
    enough = enough_motion(first)
    (fact,) = enough.facts()
    assert fact.kind is Kind.MOTION and ARM.joints[1] in fact.joints
    assert max(enough.after.values()) <= 0.05 < enough.std[ARM.joints[1]]
    assert f'record {enough.seconds:.0f} s more' in fact.sentence
    assert [sweep.joint for sweep in enough.sweeps] == [ARM.joints[1]] and not enough.together
    # The motion of the advice, at a pose of the recording.
    sweep = enough.sweeps[0]
    assert sweep.high - sweep.low == pytest.approx(1.0)
    t = np.arange(int(sweep.seconds * RATE)) / RATE
    period = 2 * (sweep.high - sweep.low) / 0.1
    q = np.repeat(first.q[400:401], len(t), axis=0)
    q[:, 1] = sweep.low + (sweep.high - sweep.low) * np.abs((2 * t / period + 1) % 2 - 1)
    assert enough_motion(concatenate([first, recorded(q)])).facts() == []


@pytest.mark.parametrize('count', [2, 12])
def test_offsets_that_differ_between_recordings_are_no_lack_of_motion(count):
    runs = [recorded(q) for q in np.split(sines(), count)]
    offsets = 10.0 * np.random.default_rng(1).standard_normal((count, len(ARM.joints)))
    shifted = concatenate([replace(r, tau=r.tau + own) for r, own in zip(runs, offsets)])
    assert enough_motion(shifted).facts() == [] == enough_motion(concatenate(runs)).facts()


def test_offsets_that_differ_are_uncertain_where_the_pose_differs_with_them():
    """A shoulder at another angle in each of six recordings, with another offset."""
    runs = []
    for angle in np.linspace(-0.7, 0.7, 6):
        q = sines(seconds=60)
        q[:, 1] = CENTRE[1] + angle
        runs.append(recorded(q))
    assert enough_motion(concatenate(runs)).facts() == []
    own = np.random.default_rng(1).normal(0, 10.0, (6, 1)) * np.eye(6)[1]
    enough = enough_motion(concatenate([replace(r, tau=r.tau + o) for r, o in zip(runs, own)]))
    assert list(enough.facts()[0].joints) == [ARM.joints[1]]


def test_joints_that_follow_others_are_named():
    # Angles are combinations of two sines, each with its own shares of them.
    t = np.arange(1800) / RATE
    two = np.stack([np.sin(2 * np.pi * t / 41), np.sin(2 * np.pi * t / 67)], axis=1)
    shares = np.random.default_rng(3).uniform(0.3, 0.6, (2, 6)) * [[1, -1, 1, 1, -1, 1]]
    enough = enough_motion(recorded(CENTRE + two @ shares))
    assert enough.directions == 2 and set(enough.dependent) == set(ARM.joints)
    assert 'span 2 directions' in enough.facts()[0].sentence
    one = sines()
    one[:, 4] = one[:, 1]
    enough = enough_motion(recorded(one))
    assert enough.dependent == (ARM.joints[1], ARM.joints[4]) and enough.directions == 5


def test_unusable():
    q = sines()
    with pytest.raises(FitError):
        enough_motion(recorded(q[:20]))
    with pytest.raises(FitError):
        enough_motion(recorded(np.repeat(q[:1], 100, axis=0)))


def test_info_prints_it_once_for_all_recordings(tmp_path, capsys):
    paths = []
    for k, amplitude in enumerate(([0.7, 0.0, 0.7, 0.7, 0.7, 0.7],
                                   [0.0, 0.6, 0.4, 0.0, 0.3, 0.0])):
        samples = recorded(sines(np.array(amplitude), 120 - 60 * k))
        paths.append(tmp_path / f'{k}.mcap')
        write_bag(paths[-1], [joint_states(samples)])
    assert main(['info', str(paths[0])]) == 0
    assert 'too little motion for a model' in ' '.join(capsys.readouterr().out.split())
    assert main(['info', *map(str, paths), '--json']) == 0
    motion = json.loads(capsys.readouterr().out)['motion']
    assert motion['seconds'] == 0 and not motion['sweeps'] and not motion['dependent']
    assert main(['info', str(paths[0]), '--json', '--effort-scale',
                 ','.join(f'{name}=1e-6' for name in ARM.joints)]) == 0
    assert json.loads(capsys.readouterr().out)['motion'] is None


TARGET = ['coulomb_friction:elbow']


def link(name: str, shape: str = '', x: float = 0.2) -> str:
    box = f'<collision><origin xyz="{x} 0 0"/><geometry>{shape}</geometry></collision>'
    return f'<link name="{name}">{box if shape else ""}</link>'


def joint(name: str, parent: str, child: str, x: float, kind: str = 'revolute') -> str:
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{x} 0 0"/><axis xyz="0 1 0"/>'
            f'<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>')


def planar(shape: str = '<box size="0.3 0.04 0.04"/>', *more: str, kind: str = 'revolute') -> str:
    """Return three links of 0.4 m in a row, each with a shape of 0.3 m in its middle."""
    return ('<robot name="r">' + link('base') + link('one', shape) + link('two', shape)
            + link('three', shape) + joint(NAMES[0], 'base', 'one', 0.0)
            + joint(NAMES[1], 'one', 'two', 0.4, kind) + joint(NAMES[2], 'two', 'three', 0.4)
            + ''.join(more) + '</robot>')


def wall(z: float) -> str:
    """Return a wall fixed to the base, 0.1 m thick, at height z in m."""
    return (f'<link name="wall"><collision><origin xyz="0.9 0 {z}"/><geometry>'
            f'<box size="0.6 1 0.1"/></geometry></collision></link>'
            f'<joint name="stands" type="fixed"><parent link="base"/><child link="wall"/></joint>')


def folded() -> np.ndarray:
    """Return a straight pose and one in which the last link lies on the first."""
    return np.array([[0.0, 0.0, 0.0], [0.0, 2.6, 2.6]])


@pytest.mark.parametrize('kind', ['revolute', 'continuous'])
def test_a_folded_arm_hits_itself(kind):
    check = self_collision(planar(kind=kind), NAMES, np.zeros((3, 3)))
    assert [len(pairs) for pairs in check.colliding(folded())] == [0, 1]
    assert check.hits(folded()) and not check.hits(folded()[:1]) and not check.overlapping
    # Neighbours may touch: the elbow alone cannot collide.
    assert not check.hits(np.array([[0.0, 3.1, 0.0]]))


def test_the_margin():
    # The wall's lower face is at 0.2 m; a level arm reaches up to 0.02 m.
    for below, hit in ((0.99, True), (1.01, False)):
        urdf = planar('<box size="0.3 0.04 0.04"/>', wall(0.02 + below * MARGIN + 0.05))
        check = self_collision(urdf, NAMES, np.array([[0.5, 0.0, 0.0]]))
        assert check.hits(np.zeros((1, 3))) is hit


def test_links_that_touch_in_recorded_poses_are_excluded():
    check = self_collision(planar(), NAMES, folded())
    assert check.overlapping == ('one_0 and three_0',) and not check.hits(folded())


@pytest.mark.parametrize('urdf, message', [
    (planar(''), 'no collision geometry'),
    (planar().replace('elbow', 'knee'), 'no moving joint elbow'),
    (planar('<mesh filename="package://arm/link.stl"/>'), 'link.stl could not be found'),
    ('<robot', 'XML')])
def test_the_reason_of_a_missing_check_is_one_line(urdf, message, tmp_path):
    with pytest.raises(CollisionsUnchecked, match=message) as caught:
        self_collision(urdf, NAMES, np.zeros((1, 3)), tmp_path)
    assert '\n' not in str(caught.value)
    path = tmp_path / 'arm.urdf'
    path.write_text(urdf)
    if 'no moving joint' in message or message == 'XML':
        # A description that the user names must match.
        with pytest.raises(GravityCompError, match='no joint elbow|not a URDF'):
            arm_limits(path, [], NAMES, np.zeros((1, 3)))
        return
    limits = arm_limits(path, [], NAMES, np.zeros((1, 3)))
    assert limits.check is None and limits.positions is not None
    assert limits.note.startswith('not checked') and message in limits.note


def test_a_plan_avoids_collisions():
    # A positive angle rotates the arm down, towards the wall.
    old = one_way(0)
    deep = old.q[:, 0] + 0.5 * old.q[:, 1]
    above = old.select(deep < 0.1)
    check = self_collision(planar('<box size="0.3 0.04 0.04"/>', wall(-0.3)), NAMES, above.q)
    # A cable is identified by the range on both sides of its start.
    target = ['cable_stiffness:shoulder']
    free = plan(old, model(), target, PlanOptions(15.0))
    number = next(k for k, q in enumerate(free.trajectory.q) if check.hits(q))
    assert not check.hits(above.q)
    options = PlanOptions(15.0, start=above.q[-1])
    kept = plan(old, model(), target, options, obstacles=check)
    between = 0.5 * (kept.trajectory.q[1:] + kept.trajectory.q[:-1])
    assert not check.hits(np.vstack([kept.trajectory.q, between]))
    with pytest.raises(OptionError, match='at the start pose the arm hits itself'):
        plan(old, model(), TARGET, PlanOptions(15.0, start=free.trajectory.q[number]),
             obstacles=check)


def test_the_command_reports_the_check(tmp_path, capsys):
    write_bag(tmp_path / 'old.mcap', [joint_states(one_way(0))])
    save_model(tmp_path / 'arm.json', model())
    (tmp_path / 'arm.urdf').write_text(planar())
    line = ['plan', str(tmp_path / 'old.mcap'), '--model', str(tmp_path / 'arm.json'),
            '--settle', 'coulomb_friction:elbow', '--duration', '8',
            '-o', str(tmp_path / 'motion.yaml')]
    assert main(line) == 0
    assert 'not checked whether the links' in ' '.join(capsys.readouterr().out.split())
    assert main([*line, '--urdf', str(tmp_path / 'arm.urdf')]) == 0
    output = ' '.join(capsys.readouterr().out.split())
    assert f'collision geometry of {tmp_path / "arm.urdf"}' in output
    assert read_trajectory(tmp_path / 'motion.yaml').joints == NAMES
