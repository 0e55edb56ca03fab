"""Columns of effects against their documented formulas, computed by hand."""

from dataclasses import replace

from effect_motions import clean_motion, exact_model
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.excitation import reversals
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.request import known_effect
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


@pytest.fixture
def motion():
    samples = JointSamples(('a', 'b'), T, Q, QD, 10 * G, np.array([0, 0, 0, 1, 1, 1]),
                           ('one', 'two'))
    gradient = np.arange(24.0).reshape(6, 2, 2)
    return Motion(samples, QDD, G, gradient, np.full(2, WIDTH))


@pytest.mark.parametrize('name, setting, column', [
    ('coulomb_friction', {}, D[:, 0]),
    ('viscous_friction', {}, QD[:, 0]),
    ('stribeck_friction', {'speed': 0.05}, D[:, 0] * np.exp(-(QD[:, 0] / 0.05) ** 2)),
    ('degressive_friction', {'power': 0.5}, D[:, 0] * np.sqrt(np.abs(QD[:, 0]))),
    ('asymmetric_friction', {}, np.abs(D[:, 0])),
    ('load_dependent_friction', {}, np.array([1, 3, 5, 0, 4, 2]) * D[:, 0]),
    ('friction_drift', {'time': 2.0}, D[:, 0] * np.exp(-AGE / 2)),
    ('coupled_friction', {'partner': 2.0, 'sign': -1.0, 'width': 0.02, 'hold': 0.0},
     np.tanh((QD[:, 0] - QD[:, 1]) / 0.02)),
    ('torque_offset', {}, np.ones(6)),
    ('torque_gain', {}, G[:, 0]),
    ('torque_drift', {'centre': 0.5}, AGE - 0.5),
    ('torque_drift', {'centre': 0.1, 'time': 2.0}, 2.0 * (1.0 - np.exp(-AGE / 2.0)) - 0.1),
    ('joint_spring', {'centre': 0.1, 'overtones': 0.0}, Q[:, 0] - 0.1),
    ('cable_stiffness', {'start': 0.0, 'side': 1.0, 'half': 9.0}, [0, 0.2, 0.1, 0, 0, 0.6]),
    ('cable_stiffness', {'start': 0.0, 'side': -1.0, 'half': 9.0}, [0, 0, 0, -0.1, -0.4, 0]),
    ('cable_stiffness', {'start': 0.0, 'side': -1.0, 'half': 0.2, 'order': 2.0},
     [0, 0, 0, -0.05, -0.8, 0]),
    ('cable_stiffness', {'start': 0.1, 'side': 0.0, 'half': 0.5},
     [-0.004, 0.004, 0, -0.032, -0.5, 0.5]),
    ('end_stop', {'start': -0.2, 'side': -1.0}, [0, 0, 0, 0, -0.2, 0]),
    ('inertia', {}, QDD[:, 0]),
    # The gradient of joint a is (0, 1), (4, 5), (8, 9) ... at one sample after the other.
    ('time_delay', {}, -(np.arange(0, 24, 4) * QD[:, 0] + np.arange(1, 24, 4) * QD[:, 1])),
])
def test_column_by_hand(motion, name, setting, column):
    columns = known_effect(name).columns(motion, 0, setting)
    np.testing.assert_allclose(columns, np.array(column, dtype=float)[:, None], atol=1e-12)


@pytest.mark.parametrize('name, setting, columns', [
    ('torque_ripple', {'k': 3.0}, [np.sin(3 * Q[:, 0]), np.cos(3 * Q[:, 0])]),
    ('coriolis', {}, [QD[:, 0] * QD[:, 1], QD[:, 1] ** 2]),
    ('inertia', {'coupled': 1.0}, [QDD[:, 0], QDD[:, 1]]),
    # The angle of joint b changes the inertia about joint a and the coupling of the two.
    ('inertia', {'coupled': 2.0}, [
        QDD[:, 0], QDD[:, 0] * np.sin(Q[:, 1]), QDD[:, 0] * np.cos(Q[:, 1]),
        QDD[:, 1], QDD[:, 1] * np.sin(Q[:, 1]), QDD[:, 1] * np.cos(Q[:, 1])]),
    # With centred factors, J is the mean inertia.
    ('inertia', {'coupled': 2.0, 'mean_s': 0.25, 'mean_c': -0.5}, [
        QDD[:, 0], QDD[:, 0] * (np.sin(Q[:, 1]) - 0.25), QDD[:, 0] * (np.cos(Q[:, 1]) + 0.5),
        QDD[:, 1], QDD[:, 1] * np.sin(Q[:, 1]), QDD[:, 1] * np.cos(Q[:, 1])]),
])
def test_columns_by_hand(motion, name, setting, columns):
    result = known_effect(name).columns(motion, 0, setting)
    np.testing.assert_allclose(result, np.column_stack(columns), atol=1e-12)


def test_columns_of_the_whole_arm_by_hand(motion):
    rows = np.arange(0.0, 24.0, 4.0)
    # d tau / d q_b is the second column of each sample's gradient.
    turned = np.column_stack([rows + 1, rows + 3])
    offset = known_effect('encoder_offset').columns(motion, 1, {'run': 1.0, 'time': 0.0})
    np.testing.assert_allclose(offset[:, :, 0], turned)
    slipped = known_effect('encoder_offset').columns(motion, 1, {'run': 1.0, 'time': 1.0})
    np.testing.assert_allclose(slipped[:, :, 0], turned * [[0], [1], [1], [1], [1], [1]])
    soft = known_effect('joint_flexibility')
    np.testing.assert_allclose(soft.columns(motion, 1, {})[:, :, 0], -turned * G[:, [1]])
    play = soft.alternative().columns(motion, 1, {})[:, :, 0]
    flank = G[:, [1]] / np.sqrt(G[:, [1]] ** 2 + (0.05 * 3.0) ** 2)
    np.testing.assert_allclose(play, -turned * flank, rtol=1e-9)


def test_inertia_has_one_symbol_per_column_and_few_columns_for_short_motion(motion):
    inertia = known_effect('inertia')
    turned = 'J m_1[s2] m_1[c2] m_2 m_2[s2] m_2[c2]'
    for coupled, symbols in ((0.0, 'J'), (1.0, 'J m_2'), (2.0, turned)):
        coefficients = inertia.coefficients_of(motion, 0, {'coupled': coupled})
        assert [c.symbol for c in coefficients] == symbols.split()
    # 4 s of motion identify one coefficient.
    assert inertia.settings(motion, 0) == [{'coupled': 0.0}]
    assert inertia.implausible(np.array([-1.0, 2.0]), {'coupled': 1.0}, motion, 0)
    assert inertia.implausible(np.array([1.0, -2.0]), {'coupled': 1.0}, motion, 0) is None


def test_presliding_column_by_hand(motion):
    columns = known_effect('presliding_hysteresis').columns(motion, 0, {'distance': 0.1})
    z = [0.0, 1 - np.exp(-2)]
    z += [-1 + (z[1] + 1) * np.exp(-1)]
    z += [0.0, -1 + np.exp(-3)]
    z += [1 + (z[4] - 1) * np.exp(-10)]
    np.testing.assert_allclose(columns[:, 0], np.array(z) - D[:, 0], atol=1e-12)


def test_a_direction_that_persists_at_rest_reverses_with_distance(motion):
    holding = Motion(motion.samples, QDD, G, motion.gradient, motion.sign_width,
                     hold=np.array([0.1, 0.0]))
    expected = known_effect('presliding_hysteresis').columns(motion, 0, {'distance': 0.1})
    np.testing.assert_allclose(holding.direction(0), expected[:, 0] + D[:, 0], atol=1e-12)
    np.testing.assert_allclose(holding.direction(1), D[:, 1])


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


def test_change_points_of_older_model_files_keep_their_meaning():
    motion, effect = clean_motion('six_axis'), known_effect('payload_change')
    runs, time = motion.samples.runs, motion.samples.t
    nonzero = np.abs(effect.columns(motion, 0, {'run': 2.0, 'time': 30.0})).max(axis=(1, 2)) > 0
    assert not nonzero[runs == 0].any() and nonzero[runs == 2].all()
    np.testing.assert_array_equal(nonzero[runs == 1], time[runs == 1] >= 30.0)


def test_change_points_are_starts_of_runs_and_times_within_them():
    motion = clean_motion('six_axis')
    points = known_effect('payload_change').settings(motion, 0)
    places = [(p['run'], p['time']) for p in points]
    assert (2.0, 0.0) in places and (3.0, 0.0) in places and (1.0, 0.0) not in places
    assert all(0 <= p['time'] < 100.0 for p in points) and len(points) == 11


def test_reversals_are_counted_within_runs(motion):
    qd = np.array([0.1, 0.1, -0.1, 0.1, 0.1, -0.1])[:, None]
    samples = JointSamples(('a',), T, qd, qd, qd, np.array([0, 0, 0, 1, 1, 1]), ('one', 'two'))
    once = Motion(samples, qd, qd, qd[:, :, None], np.array([WIDTH]))
    assert reversals(once, 0) == 2


@pytest.mark.parametrize('travel, lowest', [(6.0, 4), (1.0, 13), (0.3, 42)])
def test_the_travel_includes_two_periods_of_the_longest_ripple(travel, lowest):
    t = np.arange(0.0, 60.0, 0.05)
    q = 0.5 * travel * np.sin(0.2 * t)[:, None]
    samples = JointSamples.single_run(('swing',), t, q, 0.1 * np.cos(0.2 * t)[:, None], q)
    gravity = exact_model('pendulum').predict(q)
    motion = Motion(samples, q, gravity, gravity[:, :, None], np.array([WIDTH]))
    harmonics = [s['k'] for s in known_effect('torque_ripple').settings(motion, 0)]
    assert harmonics[0] == lowest and harmonics[-1] <= 320
    finer = known_effect('torque_ripple').refine(motion, 0, {'k': float(lowest)})
    assert all(s['k'] * travel >= 4 * np.pi - 0.01 for s in finer)


@pytest.mark.parametrize('others, untestable', [(0.0, True), (0.05, True), (0.3, False)])
def test_elastic_effects_require_a_change_of_posture(others, untestable):
    t = np.arange(0.0, 60.0, 0.1)
    q = np.column_stack([others * np.sin(0.23 * t), 0.4 * np.sin(t)])
    samples = JointSamples.single_run(('a', 'b'), t, q, np.gradient(q, t, axis=0), q)
    still = np.zeros((len(t), 2))
    motion = Motion(samples, still, still, np.zeros((len(t), 2, 2)), np.array([WIDTH, WIDTH]))
    for name in ('joint_spring', 'cable_stiffness'):
        reason = known_effect(name).untestable(motion, 1)
        assert (reason is not None and 'stand still' in reason) == untestable
