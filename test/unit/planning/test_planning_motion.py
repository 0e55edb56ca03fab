"""Limits of planned motion for any target, and its files."""

from bench.shared.planning_arm import model, NAMES, one_way, uncertain_model
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.errors import BagError, DataError, OptionError
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.planning.selection import strokes
from gravity_comp_ros.planning.trajectory_files import (
    from_yaml, read_trajectory, to_yaml, write_trajectory)
from gravity_comp_ros.planning.workspace import Line, PlanOptions, sampled, workspace
from hypothesis import assume, given, settings, strategies
import numpy as np
import pytest
import yaml

LIMITS = strategies.floats(0.02, 5.0)
POSES = strategies.lists(strategies.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)
FRICTION = 'coulomb_friction:elbow'


def check_limits(segments, limits: PlanOptions, rate: float = 2000.0) -> None:
    """Check speed, acceleration, jerk, and that the derivatives are those of the positions."""
    t, (q, qd, qdd) = sampled(segments, rate)
    assert np.abs(qd).max() <= limits.max_speed * (1 + 1e-9)
    assert np.abs(qdd).max() <= limits.max_acceleration * (1 + 1e-9)
    assert np.abs(np.diff(qdd, axis=0)).max() * rate <= limits.max_jerk * (1 + 1e-6)
    speed = np.diff(q, axis=0) * rate
    assert np.abs(speed - 0.5 * (qd[1:] + qd[:-1])).max() < 1e-3 * limits.max_jerk
    assert not qd[[0, -1]].any() or np.abs(qd[[0, -1]]).max() < 1e-9


@given(POSES, POSES, LIMITS, LIMITS, LIMITS)
def test_a_line_keeps_its_limits(a, b, speed, acceleration, jerk):
    assume(np.abs(b - a).max() > 1e-6)
    limits = PlanOptions(30.0, speed, acceleration, 10 * jerk)
    line = Line(a, b, limits)
    rate = min(2000.0, 4000.0 / line.duration)
    check_limits([line], limits, rate)
    q, qd, _ = line.at(np.array([0.0, line.duration]))
    np.testing.assert_allclose(q, [a, b], atol=1e-9)
    # The line is the fastest admissible one: it reaches one of the limits.
    t = np.linspace(0.0, line.duration, 2001)
    _, qd, qdd = line.at(t)
    jerks = np.diff(qdd, axis=0) / np.diff(t)[:, None]
    reached = [np.abs(rate).max() / limit for rate, limit in (
        (qd, speed), (qdd, acceleration), (jerks, limits.max_jerk))]
    assert max(reached) == pytest.approx(1.0, rel=0.02)


@settings(max_examples=4)
@given(seed=strategies.integers(0, 100), duration=strategies.floats(4.0, 30.0),
       speed=strategies.floats(0.05, 1.0), acceleration=strategies.floats(0.2, 3.0),
       jerk=strategies.floats(2.0, 50.0), reach=strategies.floats(0.05, 0.6),
       targets=strategies.lists(strategies.sampled_from(
           ['coulomb_friction:elbow', 'joint_spring:wrist', 'load_dependent_friction:shoulder',
            'presliding_hysteresis:elbow', 'joint_flexibility:elbow', 'gravity']),
           min_size=1, max_size=2, unique=True))
def test_a_plan_never_exceeds_its_limits(seed, duration, speed, acceleration, jerk, reach,
                                         targets):
    old = one_way(seed, duration=20.0, rate=20.0)
    options = PlanOptions(duration, speed, acceleration, jerk, reach, rate=200.0)
    try:
        planned = plan(old, uncertain_model(), targets, options)
    except OptionError:
        return  # no motion fits the limits
    motion = planned.trajectory
    assert motion.duration <= duration + 1 / options.rate
    assert np.abs(motion.qd).max() <= speed * (1 + 1e-9)
    assert np.abs(motion.qdd).max() <= acceleration * (1 + 1e-9)
    assert np.abs(np.diff(motion.qdd, axis=0)).max() * 200.0 <= jerk * (1 + 1e-6)
    assert workspace(old, options).admits(motion.q)
    apart = np.abs(motion.q[::20, None] - old.q[None]).max(axis=2).min(axis=1)
    assert apart.max() <= reach + 1e-6
    assert (motion.q >= old.q.min(axis=0) - 1e-9).all()
    assert (motion.q <= old.q.max(axis=0) + 1e-9).all()
    np.testing.assert_allclose(motion.q[0], motion.q[-1], atol=1e-9)
    assert np.abs(motion.qd[[0, -1]]).max() < 1e-9


@settings(max_examples=2)
@given(seed=strategies.integers(0, 100), duration=strategies.floats(4.0, 30.0),
       speed=strategies.floats(0.05, 1.0), reach=strategies.floats(0.05, 2.0))
def test_strokes_keep_their_limits(seed, duration, speed, reach):
    old = one_way(seed, duration=20.0, rate=20.0)
    limits = PlanOptions(duration, speed, reach=reach)
    space = workspace(old, limits)
    parts = strokes(space, model(), (0, 2), limits)
    assert {part.joints for part in parts} == {(0,), (2,), (0, 2)}
    for part in parts[::7]:
        check_limits(part.lines, limits, 500.0)
        _, (q, _, _) = sampled([*part.way, *part.lines], 100.0)
        assert space.admits(q)
        np.testing.assert_allclose(q[[0, -1]], [space.start, part.stops[0]], atol=1e-9)


def test_custom_start_and_limits():
    old = one_way(0)
    start = old.q[900]
    options = PlanOptions(10.0, start=start, low=np.full(3, -0.45), high=np.full(3, 0.45),
                          reach=float('inf'))
    motion = plan(old, model(), [FRICTION], options).trajectory
    np.testing.assert_allclose(motion.q[[0, -1]], [start, start], atol=1e-9)
    assert np.abs(motion.q).max() <= 0.45 + 1e-9
    beyond = PlanOptions(low=np.full(3, 5.0), high=np.full(3, 6.0))
    for wrong, message in ((PlanOptions(start=np.full(3, 9.0)), 'start pose is not admissible'),
                           (PlanOptions(start=np.zeros(2)), '3 joints'),
                           (PlanOptions(low=np.zeros(2), high=np.ones(2)), '3 joints'),
                           (beyond, 'no recorded pose')):
        with pytest.raises(OptionError, match=message):
            plan(old, model(), [FRICTION], wrong)


@pytest.fixture(scope='module')
def motion() -> Trajectory:
    return plan(one_way(0), model(), [FRICTION], PlanOptions(12.0)).trajectory


def test_yaml_is_a_joint_trajectory_message(motion):
    text = to_yaml(motion, ['elbow\nback and forth'])
    assert text.startswith('# elbow back and forth\n')
    message = yaml.safe_load(text)
    assert set(message) == {'joint_names', 'points'}
    assert message['joint_names'] == list(NAMES)
    assert set(message['points'][0]) == {'positions', 'velocities', 'accelerations',
                                         'time_from_start'}
    times = [p['time_from_start']['sec'] + 1e-9 * p['time_from_start']['nanosec']
             for p in message['points']]
    assert times[0] == 0.0 and times[-1] == pytest.approx(motion.duration)
    assert set(yaml.safe_load(to_yaml(motion, goal=True))) == {'trajectory'}
    # The largest argument of a command has 128 KiB.
    assert len(text) < 100_000


def test_a_trajectory_read_from_yaml_equals_the_plan(motion):
    again = from_yaml(to_yaml(motion, goal=True))
    q, qd, _ = again.at(motion.t)
    assert np.abs(q - motion.q).max() < 1e-3
    assert np.abs(qd - motion.qd).max() < 0.01
    assert np.abs(qd).max() <= 0.3 * 1.01


def test_effort_and_mcap(motion, tmp_path):
    with_effort = Trajectory(motion.joints, motion.t, motion.q, motion.qd, motion.qdd,
                             model().predict(motion.q))
    write_trajectory(tmp_path / 'motion.yaml', with_effort)
    again = read_trajectory(tmp_path / 'motion.yaml')
    assert again.effort is not None and again.joints == NAMES
    write_trajectory(tmp_path / 'motion.mcap', with_effort)
    from gravity_comp_ros.recordings.bag import read_bag
    samples = read_bag(tmp_path / 'motion.mcap').samples
    np.testing.assert_allclose(samples.q, motion.q, atol=1e-12)
    with pytest.raises(BagError, match='does not end in'):
        write_trajectory(tmp_path / 'motion.txt', motion)


@pytest.mark.parametrize('name, text', [
    ('a.yaml', 'points: ['), ('a.yaml', '3'), ('a.yaml', 'joint_names: [a]\npoints: []'),
    ('a.yaml', ''), ('a.yaml', 't,q_a\n0,nan\n1,0'),
    ('a.yaml', 'joint_names: [a]\npoints: [{positions: [1]}]')])
def test_files_without_a_trajectory(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(BagError, match='contains no joint trajectory') as caught:
        read_trajectory(path)
    assert '\n' not in str(caught.value)
    with pytest.raises(BagError, match='no such file'):
        read_trajectory(tmp_path / 'none.yaml')


def test_a_trajectory_is_checked():
    one = np.zeros((2, 1))
    with pytest.raises(DataError, match='increasing times'):
        Trajectory(('a',), np.zeros(2), one, one, one)
    with pytest.raises(DataError, match='qd has shape'):
        Trajectory(('a',), np.arange(2.0), one, np.zeros((2, 2)), one)
