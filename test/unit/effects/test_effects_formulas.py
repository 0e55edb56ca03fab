"""Columns of effects against their documented formulas, computed by hand."""

from dataclasses import replace

from bench.shared.effect_motions import clean_motion
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.changes import change_factor
from gravity_comp_ros.effects.excitation import reversals
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import SHORTEST
from gravity_comp_ros.effects.registry import known_effect
import numpy as np
import pytest

WIDTH = 0.01
# Two joints, two runs of three samples, 1 s apart; the second run begins at 100 s.
T = np.array([0.0, 1.0, 2.0, 100.0, 101.0, 102.0])
Q = np.array([[0.0, 0.5], [0.2, 0.4], [0.1, 0.3], [-0.1, 0.3], [-0.4, 0.0], [0.6, -0.2]])
QD = np.array([[0.02, 0.0], [0.0, -0.03], [-0.1, 0.1], [0.005, 0.2], [-0.02, -0.2], [0.3, 0.1]])
QDD = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0], [9.0, 10.0], [11.0, 12.0]])
G = np.array([[1.0, -2.0], [-3.0, 2.0], [5.0, 0.5], [0.0, -1.0], [-4.0, 3.0], [2.0, 2.0]])
D = np.tanh(QD / WIDTH)
AGE = np.array([0.0, 1.0, 2.0, 0.0, 1.0, 2.0])


CLOCK = 1.7e9
LAW = {'width': WIDTH}
SLOPE = np.arange(24.0).reshape(6, 2, 2)


def risen(age):
    """Return the first column of a drift at an age over its time constant."""
    return age * np.exp(-age)


def motion_of(samples, **given):
    """Return a motion with the gravity, gradient and acceleration above."""
    return Motion(samples, QDD, G, lambda q: SLOPE, **given)


@pytest.fixture
def motion():
    return motion_of(JointSamples(('a', 'b'), T, Q, QD, 10 * G, np.array([0, 0, 0, 1, 1, 1]),
                                  ('one', 'two')))


def stamped(motion, *starts):
    """Return the motion with the starts of its runs on a clock."""
    return replace(motion, samples=replace(motion.samples, starts=starts))


@pytest.mark.parametrize('name, setting, column', [
    ('coulomb_friction', LAW, D[:, 0]),
    ('coulomb_friction', {'ramp': 0.05}, [0.4, 0, -1, 0.1, -0.4, 1]),
    ('viscous_friction', {}, QD[:, 0]),
    ('asymmetric_friction', LAW, np.abs(D[:, 0])),
    ('load_dependent_friction', LAW, np.array([1, 3, 5, 0, 4, 2]) * D[:, 0]),
    ('load_dependent_friction', {'friction': 0.5, **LAW},
     np.abs(G[:, 0] + 0.5 * D[:, 0]) * D[:, 0]),
    ('coupled_friction', {'partner': 2.0, 'sign': -1.0, 'width': 0.02},
     np.tanh((QD[:, 0] - QD[:, 1]) / 0.02)),
    ('stribeck_friction', {'speed': 0.05, **LAW}, D[:, 0] * np.exp(-(QD[:, 0] / 0.05) ** 2)),
    ('degressive_friction', {'power': 0.5, **LAW}, D[:, 0] * np.sqrt(np.abs(QD[:, 0]))),
    ('torque_offset', {}, np.ones(6)),
    ('torque_gain', {}, G[:, 0]),
    ('cable_stiffness',
     {'start': 0.1, 'side': 0.0, 'half': 0.5, 'order': 3.0, 'hardening': 1.0},
     [-0.004, 0.004, 0, -0.032, -0.5, 0.5]),
    ('cable_stiffness',
     {'start': 0.0, 'side': 1.0, 'half': 0.1, 'order': 3.0, 'hardening': 0.5},
     [0, 0.5, 0.1, 0, 0, 11.1]),
    ('cable_stiffness',
     {'start': 0.0, 'side': -1.0, 'half': 0.2, 'order': 2.0, 'hardening': 0.2},
     [0, 0, 0, -0.09, -0.48, 0]),
    ('end_stop', {'start': -0.2, 'side': -1.0}, [0, 0, 0, 0, -0.2, 0]),
    # The gradient of joint a is (0, 1), (4, 5), (8, 9) ... at one sample after the other.
    ('time_delay', {}, -(np.arange(0, 24, 4) * QD[:, 0] + np.arange(1, 24, 4) * QD[:, 1])),
])
def test_column_by_hand(motion, name, setting, column):
    columns = known_effect(name).columns(motion, 0, setting)
    np.testing.assert_allclose(columns, np.array(column, dtype=float)[:, None], atol=1e-12)


@pytest.mark.parametrize('name, setting, columns', [
    ('torque_ripple', {'k': 3.0, 'harmonics': 1.0}, [np.sin(3 * Q[:, 0]), np.cos(3 * Q[:, 0])]),
    ('torque_ripple', {'k': 3.0, 'harmonics': 2.0},
     [np.sin(3 * Q[:, 0]), np.sin(6 * Q[:, 0]), np.cos(3 * Q[:, 0]), np.cos(6 * Q[:, 0])]),
    ('joint_spring', {'centre': 0.1, 'overtones': 0.0}, [Q[:, 0] - 0.1, np.ones(6)]),
    ('joint_spring', {'centre': 0.1, 'overtones': 2.0},
     [np.sin(2 * Q[:, 0]), np.sin(3 * Q[:, 0]), np.cos(2 * Q[:, 0]), np.cos(3 * Q[:, 0])]),
    ('friction_drift', {'time': 2.0, 'origin': 0.0, **LAW},
     [D[:, 0] * (np.exp(-AGE / 2) - 1), QD[:, 0] * (np.exp(-AGE / 2) - 1)]),
    ('torque_drift', {'origin': 0.0, 'time': 2.0},
     [risen(AGE / 2), 1 - (1 + AGE / 2) * np.exp(-AGE / 2)]),
])
def test_columns_by_hand(motion, name, setting, columns):
    result = known_effect(name).columns(motion, 0, setting)
    np.testing.assert_allclose(result, np.column_stack(columns), atol=1e-12)


def test_a_spring_on_a_crank_has_the_symbols_of_its_columns(motion):
    spring = known_effect('joint_spring')
    symbols = [c.symbol for c in spring.coefficients_of(motion, 0, {'overtones': 2.0})]
    assert symbols == ['a_2', 'a_3', 'b_2', 'b_3']
    assert [c.symbol for c in spring.coefficients_of(motion, 0, {'overtones': 0.0})] == ['k', 'm']


def test_a_drift_goes_on_in_a_later_recording(motion):
    """The first recording begins at 1.7e9 s on the clock, the later one 1000 s after it."""
    drift, warmth = known_effect('torque_drift'), known_effect('friction_drift')
    first, later = stamped(motion, CLOCK, CLOCK), stamped(motion, CLOCK + 1000.0, CLOCK + 1000.0)
    law = {**drift.settings(first, 0)[0], 'time': 500.0, **LAW}
    assert law['origin'] == CLOCK
    for stamps, age in ((first, T), (later, T + 1000.0)):
        np.testing.assert_allclose(drift.columns(stamps, 0, law)[:, 0], risen(age / 500.0))
    np.testing.assert_allclose(warmth.columns(later, 0, law)[:, 0],
                               D[:, 0] * (np.exp(-(T + 1000.0) / 500.0) - 1.0), atol=1e-12)
    # An earlier recording is before the drift; one without a clock begins at 0 with each run.
    earlier = stamped(motion, CLOCK - 1000.0, CLOCK - 1000.0)
    assert not drift.columns(earlier, 0, law).any()
    np.testing.assert_allclose(drift.columns(motion, 0, law)[:, 0], risen(AGE / 500.0))
    # On the next day the arm is cold again, and so it is where both days are fitted.
    cold = stamped(motion, CLOCK + 86400.0, CLOCK + 86400.0)
    np.testing.assert_allclose(drift.columns(cold, 0, law)[:, 0], risen(T / 500.0))
    both = replace(motion, samples=concatenate([first.samples, later.samples, cold.samples]))
    law = {**drift.settings(both, 0)[0], 'time': 500.0}
    age = np.concatenate([T, T + 1000.0, T])
    np.testing.assert_allclose(drift.columns(both, 0, law)[:, 0], risen(age / 500.0))
    next_day = stamped(motion, CLOCK + 90000.0, CLOCK + 90000.0)
    np.testing.assert_allclose(drift.columns(next_day, 0, law)[:, 0],
                               risen((T + 3600.0) / 500.0))
    # Stamps near zero are no clock.
    assert known_effect('torque_drift').settings(stamped(motion, 0.0, 0.0), 0)[0]['origin'] == 0.0


def test_samples_of_a_node_go_on_from_the_origin(motion):
    """Samples an hour or a day after the session: the arm may have worked all the time."""
    drift = known_effect('torque_drift')
    law = {**drift.settings(stamped(motion, CLOCK, CLOCK), 0)[0], 'time': 2e4}
    for age in (3600.0, 86400.0):
        live = motion_of(JointSamples.single_run(
            ('a', 'b'), CLOCK + age + np.arange(2.0), Q[:2], QD[:2], G[:2], 'live', 0.0))
        np.testing.assert_allclose(drift.columns(live, 0, law)[0, 0], risen(age / 2e4))
        # A fit of the node keeps its clock.
        assert drift.settings(live, 0)[0]['origin'] == CLOCK + age


def test_presliding_and_its_rate_by_hand(motion):
    columns = known_effect('presliding_hysteresis').columns(motion, 0, {'distance': 0.1})
    step = [0.0, 1.0, -1.0, 0.0, -1.0, 1.0]
    z = [0.0, 1 - np.exp(-2)]
    z += [-1 + (z[1] + 1) * np.exp(-1)]
    z += [0.0, -1 + np.exp(-3)]
    z += [1 + (z[4] - 1) * np.exp(-10)]
    np.testing.assert_allclose(columns[:, 0], np.subtract(z, step), atol=1e-12)
    # The samples are 1 s apart: differences at the ends of a run, half of them between.
    rate = [z[1] - z[0], (z[2] - z[0]) / 2, z[2] - z[1],
            z[4] - z[3], (z[5] - z[3]) / 2, z[5] - z[4]]
    np.testing.assert_allclose(columns[:, 1], rate, atol=1e-12)


def test_a_direction_that_persists_at_rest_is_that_of_presliding(motion):
    presliding = known_effect('presliding_hysteresis').columns(motion, 0, {'distance': 0.1})
    coulomb = known_effect('coulomb_friction')
    expected = [coulomb.columns(motion, 0, law)[:, 0] for law in ({'distance': 0.1}, SHORTEST)]
    np.testing.assert_allclose(presliding[:, 0], expected[0] - expected[1], atol=1e-12)


def test_columns_of_the_whole_arm_by_hand(motion):
    rows = np.arange(0.0, 24.0, 4.0)
    # d tau / d q_b is the second column of each sample's gradient.
    turned = np.column_stack([rows + 1, rows + 3])
    slipped = known_effect('encoder_offset').columns(
        motion, 1, {'run': 1.0, 'time': 1.0, 'clock': 0.0})
    np.testing.assert_allclose(slipped[:, :, 0], turned * [[-1], [0], [0], [0], [0], [0]])
    soft = known_effect('joint_flexibility')
    np.testing.assert_allclose(soft.columns(motion, 1, {})[:, :, 0], -turned * G[:, [1]])


@pytest.mark.parametrize('name, columns, expected', [
    ('coulomb_friction', [1.0], [2.0]),
    ('viscous_friction', [0.1], [20.0]),
    ('joint_spring', [0.5, 1.0], [6.0, 6.0]),
    ('torque_offset', [1.0], [6.0]),
    # A tenth of 20 N·m over the RMS of the column, by default.
    ('degressive_friction', [0.25], [8.0]),
    ('torque_drift', [50.0, 7.0], [2.0, 2.0]),
    ('torque_gain', [7.0], [0.1]),
    ('base_tilt', [7.0, 2.0], [0.1, 0.1]),
    ('payload_change', [1.0, 2.0], [10.0, 10.0]),
    ('presliding_hysteresis', [1.0, 9.0], [2.0, 0.4]),
    ('time_delay', [3.0], [0.02]),
])
def test_prior_standard_deviations_by_hand(name, columns, expected):
    std = known_effect(name).prior_std(20.0, np.array(columns))
    np.testing.assert_allclose(std, expected)


@pytest.mark.parametrize('name', ['torque_drift', 'friction_drift'])
@pytest.mark.parametrize('seconds', [20.0, 4000.0])
def test_time_constants_are_those_of_a_thermal_process(name, seconds):
    """A shorter one explains the start of a motion; each is compared once."""
    t = np.linspace(0.0, seconds, 50)
    motion = motion_of(JointSamples.single_run(('a',), t, *3 * [np.sin(t)[:, None]]))
    times = {setting['time'] for setting in known_effect(name).settings(motion, 0)}
    assert min(times) == max(120.0, 0.1 * seconds) and len(times) == 4
    assert max(times) == pytest.approx(3.0 * max(120.0, seconds))


@pytest.mark.parametrize('starts', [(), (1.7e9, 1.7e9 + 200.0, 1.7e9 + 400.0)])
def test_gravity_includes_the_last_payload(starts):
    motion, effect = clean_motion('six_axis'), known_effect('payload_change')
    motion = replace(motion, samples=replace(motion.samples, starts=starts))
    runs, time = motion.samples.runs, motion.samples.t
    first = float(time[runs == 1][0])
    setting = {'run': 2.0, 'time': 30.0, 'clock': starts[1] + first + 30.0 if starts else 0.0}
    before = np.abs(effect.columns(motion, 0, setting)).max(axis=(1, 2)) > 0
    assert before[runs == 0].all() and not before[runs == 2].any()
    np.testing.assert_array_equal(before[runs == 1], time[runs == 1] < first + 30.0)


def test_a_later_recording_has_the_last_payload():
    motion, effect = clean_motion('six_axis'), known_effect('payload_change')
    stamped = {number: replace(motion.samples, starts=tuple(
        stamp + 200.0 * k for k in range(3))) for number, stamp in enumerate((1.7e9, 1.7e9 + 1e5))}
    changed = replace(motion, samples=stamped[0])
    for setting in effect.settings(changed, 0):
        assert setting['clock'] > 1.7e9 and effect.columns(changed, 0, setting).any()
        later = replace(motion, samples=stamped[1])
        assert not effect.columns(later, 0, setting).any()
        assert not effect.columns(motion, 0, setting).any()
        # Times from 0, as of a simulation or a table, are of no clock.
        counted = replace(motion, samples=replace(motion.samples, starts=(0.0, 200.0, 400.0)))
        assert not effect.columns(counted, 0, setting).any()


def test_other_recordings_without_a_clock_have_the_last_payload():
    motion, effect = clean_motion('six_axis'), known_effect('payload_change')
    one, two, three = motion.samples.each_run()
    other = replace(motion, samples=concatenate(
        [replace(run, fingerprints=(1 + k,)) for k, run in enumerate((one, two, three))]))
    moved = replace(motion, samples=concatenate([replace(three, fingerprints=(1,)), one, two]))
    for setting in effect.settings(motion, 0):
        assert setting['clock'] == 0.0 and effect.columns(motion, 0, setting).any()
        assert not effect.columns(other, 0, setting).any()
        # A recording is known by its samples, not by its number.
        if setting['run'] == 2.0:
            np.testing.assert_array_equal(
                change_factor(moved, setting)[moved.samples.runs == 2],
                change_factor(motion, setting)[motion.samples.runs == 1])


def test_change_points_are_starts_of_runs_and_times_within_them():
    motion = clean_motion('six_axis')
    points = known_effect('payload_change').settings(motion, 0)
    places = [(p['run'], p['time']) for p in points]
    assert (2.0, 0.0) in places and (3.0, 0.0) in places and (1.0, 0.0) not in places
    assert all(0 <= p['time'] < 100.0 for p in points) and len(points) == 11


@pytest.mark.parametrize('name', ['encoder_offset', 'base_tilt', 'payload_change'])
def test_a_change_has_motion_before_and_after_it(name):
    # At the end of a recording the effect would be a part of gravity.
    motion, effect = clean_motion('six_axis'), known_effect(name)
    seconds = 300.0
    for setting in effect.settings(motion, 1):
        for step in (0.5, 1.0, 2.0, 3.9):
            for point in effect.refine(motion, 1, setting, step):
                before = seconds * (change_factor(motion, point) < 0.0).mean()
                assert 9.9 <= before <= seconds - 9.9
    samples = motion.samples
    short = replace(motion, samples=samples.select(samples.t < 6.0), memo={})
    assert not effect.settings(replace(short, samples=short.samples.select(
        short.samples.runs == 0)), 1)


def test_reversals_are_counted_within_runs(motion):
    qd = np.array([0.1, 0.1, -0.1, 0.1, 0.1, -0.1])[:, None]
    samples = JointSamples(('a',), T, qd, qd, qd, np.array([0, 0, 0, 1, 1, 1]), ('one', 'two'))
    assert reversals(Motion(samples, qd, qd, lambda q: q[:, :, None]), 0) == 2


@pytest.mark.parametrize('travel, lowest', [(6.0, 4), (0.5, 7), (0.3, 11)])
def test_the_travel_includes_the_periods_of_the_longest_ripple(travel, lowest):
    t = np.arange(0.0, 60.0, 0.05)
    q = 0.5 * travel * np.sin(0.2 * t)[:, None]
    samples = JointSamples.single_run(('swing',), t, q, 0.1 * np.cos(0.2 * t)[:, None], q)
    motion = Motion(samples, q, q, lambda q: q[:, :, None])
    harmonics = [s['k'] for s in known_effect('torque_ripple').settings(motion, 0)]
    assert harmonics[0] == lowest and harmonics[-1] <= 320
    finer = known_effect('torque_ripple').refine(motion, 0, {'k': float(lowest), 'harmonics': 1.0},
                                                 1.0)
    assert all(s['k'] * travel >= np.pi - 0.01 for s in finer)


def test_a_spring_is_a_torsion_spring_or_on_a_crank():
    t = np.arange(0.0, 60.0, 0.1)
    for half, orders in ((0.05, []), (0.4, [0.0, 1.0, 2.0])):
        q = 0.3 + half * np.sin(t)[:, None]
        samples = JointSamples.single_run(('a',), t, q, np.gradient(q, t, axis=0), q)
        spring = known_effect('joint_spring')
        motion = Motion(samples, q, q, lambda q: q[:, :, None])
        assert ('travels' in (spring.untestable(motion, 0) or '')) == (not orders)
        if orders:
            settings = spring.settings(motion, 0)
            assert [s['overtones'] for s in settings] == orders
            assert settings[0]['centre'] == pytest.approx(0.3, abs=0.01)
