"""Motion of a recording: acceleration, gradient of gravity, and direction of motion."""

from effect_motions import arm_of, clean_motion, clean_samples, exact_model, motions_of
from gravity_comp_ros.data.acceleration import AccelerationOptions, accelerations
from gravity_comp_ros.data.runs import run_time
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.excitation import reversals
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.effects.motion_direction import (
    direction, find_shape, MIN_WIDTH, min_widths, Shape, speed_noise)
from gravity_comp_ros.effects.presliding import evenly_spaced, position_noise
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.simulation.disturbances.lugre import friction_torque, LuGre
import numpy as np
import pytest

EFFECTS = library_effects()
FRICTION = [name for name, effect in EFFECTS.items() if effect.family == 'friction']


def test_gradient_is_that_of_finite_differences():
    model, step = exact_model('iiwa7'), 1e-6
    q = np.random.default_rng(0).uniform(-2, 2, (20, 7))
    for j in range(7):
        shift = step * np.eye(7)[j]
        slope = (model.predict(q + shift) - model.predict(q - shift)) / (2 * step)
        np.testing.assert_allclose(gravity_gradient(model, q)[:, :, j], slope, atol=1e-6)


def test_gradient_in_batches_is_the_same():
    model = exact_model('pendulum')
    q = np.linspace(-3, 3, 9001)[:, None]
    weights = dict(zip(model.torques[0].indices, model.torques[0].weights))
    by_hand = weights[1] * np.cos(q) - weights[2] * np.sin(q)
    np.testing.assert_allclose(gravity_gradient(model, q)[:, :, 0], by_hand, atol=1e-12)


def test_acceleration_is_that_of_the_motion():
    samples, truth = clean_samples('iiwa7'), np.concatenate([m.qdd for m in motions_of('iiwa7')])
    # At the start of a pause, acceleration changes within the window.
    assert np.abs(accelerations(samples) - truth).max() < 0.1 * np.abs(truth).max()
    error = accelerations(samples) - truth
    assert np.sqrt((error ** 2).mean()) < 0.02 * np.sqrt((truth ** 2).mean())


def test_acceleration_is_computed_within_runs():
    samples = clean_samples('six_axis')
    joined = accelerations(samples)
    for number in range(samples.n_runs):
        np.testing.assert_array_equal(joined[samples.runs == number],
                                      accelerations(samples.run(number)))


def test_constant_acceleration_at_an_uneven_rate():
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.01, 0.03, 800))
    qd = (0.3 * t + 0.1)[:, None]
    samples = JointSamples.single_run(('a',), t, 0.15 * t[:, None] ** 2, qd, qd)
    np.testing.assert_allclose(accelerations(samples), 0.3, atol=1e-6)


def test_noise_of_acceleration_is_as_documented():
    rng = np.random.default_rng(2)
    qd = 1e-3 * rng.standard_normal((20000, 1))
    samples = JointSamples.single_run(('a',), np.arange(20000) / 50, qd, qd, qd)
    assert accelerations(samples).std() == pytest.approx(0.006, rel=0.1)


def test_poses_at_rest_have_no_acceleration():
    q = np.random.default_rng(0).uniform(-2, 2, (50, 6))
    samples = JointSamples.single_run(arm_of('six_axis').joints, 2.0 * np.arange(50), q,
                                      np.zeros((50, 6)), q)
    motion = build_motion(samples, exact_model('six_axis'))
    assert not motion.qdd.any()
    for name in FRICTION + ['inertia', 'coriolis', 'time_delay']:
        for joint in range(6):
            assert EFFECTS[name].untestable(motion, joint), name


def test_an_isolated_sample_has_no_acceleration():
    t = np.array([0.0, 0.02, 0.04, 5.0, 9.0, 9.02, 9.04])
    qd = np.linspace(0.1, 0.2, 7)[:, None]
    assert accelerations(JointSamples.single_run(('a',), t, qd, qd, qd))[3, 0] == 0.0


def test_joints_are_in_the_models_order():
    model, samples = exact_model('six_axis'), clean_samples('six_axis')
    turned = build_motion(samples.joints(samples.names[::-1]), model)
    straight = clean_motion('six_axis')
    assert turned.samples.names == model.joints
    np.testing.assert_array_equal(turned.gravity, straight.gravity)
    np.testing.assert_array_equal(turned.qdd, straight.qdd)


def test_unusable_input_is_refused():
    model, samples = exact_model('six_axis'), clean_samples('six_axis')
    with pytest.raises(ModelMismatchError, match='elbow_joint'):
        build_motion(samples.joints(['wrist_1_joint']), model)
    with pytest.raises(DataError, match='no samples'):
        build_motion(samples.select(np.zeros(len(samples), dtype=bool)), model)
    with pytest.raises(OptionError, match='window'):
        AccelerationOptions(window=0.0)


def back_and_forth(noise, seed=0):
    """Return samples of a joint that moves and rests, its true angle and speed, and noise."""
    rng = np.random.default_rng(seed)
    clock = np.arange(0.0, 300.0, 0.02)
    # The joint is at rest for 10 s in every 50 s.
    t = np.minimum(clock % 50.0, 40.0) + 40.0 * np.floor(clock / 50.0)
    q = 0.4 * np.sin(0.3 * t) + 0.2 * np.sin(0.77 * t + 1)
    v = np.gradient(q, clock)
    seen = v + noise * rng.standard_normal(len(t))
    flutter = 1e-6 * rng.standard_normal(len(t))
    samples = JointSamples.single_run(('a',), clock, (q + flutter)[:, None], seen[:, None],
                                      np.zeros((len(t), 1)))
    return samples, q, v, rng.standard_normal(len(t))


def shape_of(samples, residual):
    return find_shape(samples, samples.q[:, 0], samples.qd[:, 0],
                      accelerations(samples)[:, 0], residual, float(min_widths(samples)[0]))


def direction_of(samples, shape):
    return direction(samples, samples.q[:, 0], samples.qd[:, 0], shape)


@pytest.mark.parametrize('width', [0.006, 0.015])
def test_width_is_estimated_from_friction(width):
    samples, _, v, noise = back_and_forth(2e-4)
    shape = shape_of(samples, np.tanh(v / width) + 0.1 * noise)
    assert shape.hold == 0.0 and shape.width == pytest.approx(width, rel=0.2)


@pytest.mark.parametrize('seed', range(10))
def test_a_ramp_is_distinguished_from_a_smooth_sign(seed):
    """Friction of a constraint that yields with speed, as in simulators, is a ramp."""
    samples, _, v, noise = back_and_forth(2e-4, seed)
    ramp = np.clip(v / 0.03, -1.0, 1.0)
    shape = shape_of(samples, ramp + 0.1 * noise)
    assert shape.ramp and shape.width == pytest.approx(0.015, rel=0.1)
    np.testing.assert_allclose(direction_of(samples, Shape(0.015, ramp=True)), ramp, atol=0.04)
    assert not shape_of(samples, np.tanh(v / 0.015) + 0.1 * noise).ramp


def test_friction_that_persists_at_rest_is_distinguished():
    samples, q, v, noise = back_and_forth(5e-4)
    bristles = friction_torque(samples.t, q, v, LuGre(1.0, presliding=2e-4))
    shape = shape_of(samples, bristles + 0.1 * noise)
    assert shape.hold == pytest.approx(2e-4, rel=0.3)
    values = direction_of(samples, shape)
    slope = values @ bristles / (values @ values)
    assert slope == pytest.approx(1.0, abs=0.01)
    assert (bristles - slope * values).std() < 0.03
    let_go = shape_of(samples, np.tanh(v / 0.002) + 0.1 * noise)
    assert let_go.hold == 0.0


def test_hold_distance_is_estimated_with_lost_messages():
    samples, q, v, noise = back_and_forth(5e-4)
    torque = friction_torque(samples.t, q, v, LuGre(1.0, presliding=2e-4)) + 0.1 * noise
    kept = np.random.default_rng(5).random(len(samples)) > 0.12
    assert shape_of(samples.select(kept), torque[kept]).hold == pytest.approx(2e-4, rel=0.4)


def test_width_without_friction_follows_from_noise():
    samples, _, _, noise = back_and_forth(2e-3)
    shape = shape_of(samples, 0.1 * noise)
    assert shape.hold == 0.0 and shape.width == pytest.approx(6e-3, rel=0.1)
    np.testing.assert_array_equal(direction_of(samples, shape),
                                  np.tanh(samples.qd[:, 0] / shape.width))
    assert min_widths(back_and_forth(0.0)[0])[0] == MIN_WIDTH


def test_the_direction_does_not_absorb_viscous_friction():
    samples, _, _, noise = back_and_forth(1e-4)
    for residual in (5.0 * samples.qd[:, 0], 5.0 * samples.qd[:, 0] + 0.1 * noise):
        assert shape_of(samples, residual).width == MIN_WIDTH


def test_presliding_beyond_half_a_milliradian_is_not_part_of_the_direction():
    samples, q, v, noise = back_and_forth(5e-4)
    slow = friction_torque(samples.t, q, v, LuGre(1.0, presliding=0.02))
    shape = shape_of(samples, slow + 0.1 * noise)
    assert (slow - direction_of(samples, shape)).std() > 0.1


def test_speed_noise_excludes_motion():
    assert speed_noise(back_and_forth(1e-3)[0])[0] == pytest.approx(1e-3, rel=0.1)
    assert speed_noise(back_and_forth(0.0)[0])[0] < 1e-7


def swing(q, qd):
    """Return the motion of the pendulum along q (M,), at 20 Hz."""
    t = np.arange(len(q)) / 20
    model = exact_model('pendulum')
    samples = JointSamples.single_run(('swing',), t, q[:, None], qd[:, None],
                                      model.predict(q[:, None]))
    return build_motion(samples, model)


def test_friction_is_untestable_in_one_way_motion():
    t = np.arange(0.0, 40.0, 0.05)
    motion = swing(0.05 * t + 0.1 * np.sin(0.3 * t), 0.05 + 0.03 * np.cos(0.3 * t))
    for name in ('coulomb_friction', 'viscous_friction', 'load_dependent_friction',
                 'friction_drift', 'presliding_hysteresis'):
        assert 'one direction only' in EFFECTS[name].untestable(motion, 0)
    assert EFFECTS['joint_spring'].untestable(motion, 0) is None


def test_speed_dependence_is_untestable_at_one_speed():
    leg = np.linspace(0.0, 1.0, 200)
    q = np.concatenate([leg, leg[::-1]] * 3)
    qd = np.where(np.arange(len(q)) // 200 % 2, -0.1, 0.1)
    motion = swing(q, qd)
    assert EFFECTS['coulomb_friction'].untestable(motion, 0) is None
    for name in ('viscous_friction', 'stribeck_friction', 'degressive_friction'):
        assert 'one speed' in EFFECTS[name].untestable(motion, 0)
    assert 'never at rest' in EFFECTS['asymmetric_friction'].untestable(motion, 0)
    assert EFFECTS['presliding_hysteresis'].untestable(motion, 0) is None
    assert reversals(motion, 0) == 5


def test_presliding_is_untestable_with_few_reversals():
    t = np.arange(0.0, 40.0, 0.05)
    motion = swing(np.sin(0.15 * t), 0.15 * np.cos(0.15 * t))
    assert 'reversals' in EFFECTS['presliding_hysteresis'].untestable(motion, 0)


def test_load_dependence_is_untestable_at_constant_load():
    t = np.arange(0.0, 60.0, 0.05)
    level = np.arctan2(0.1, 0.4)
    motion = swing(level + 0.02 * np.sin(t), 0.02 * np.cos(t))
    assert 'hardly varies' in EFFECTS['load_dependent_friction'].untestable(motion, 0)
    for name in ('joint_spring', 'cable_stiffness', 'end_stop'):
        assert 'travels' in EFFECTS[name].untestable(motion, 0)


def test_drift_is_untestable_in_short_runs():
    t = np.arange(0.0, 8.0, 0.05)
    motion = swing(np.sin(2 * t), 2 * np.cos(2 * t))
    assert 'too short' in EFFECTS['torque_drift'].untestable(motion, 0)
    assert 'too short' in EFFECTS['friction_drift'].untestable(motion, 0)


def test_effects_of_several_joints_are_untestable_on_one():
    motion = clean_motion('pendulum')
    for name in ('coriolis', 'coupled_friction', 'base_tilt', 'tool_force'):
        assert EFFECTS[name].untestable(motion, 0), name


def test_coupled_friction_is_untestable_for_joints_in_lockstep():
    motion = clean_motion('six_axis')
    assert EFFECTS['coupled_friction'].untestable(motion, 2) is None
    q, qd = motion.samples.q.copy(), motion.samples.qd.copy()
    q[:, [1, 3]], qd[:, [1, 3]] = q[:, [2]], qd[:, [2]]
    same = JointSamples(motion.samples.names, motion.samples.t, q, qd, motion.samples.tau,
                        motion.samples.runs, motion.samples.run_labels)
    lockstep = build_motion(same, motion.model)
    assert 'neither neighbour' in EFFECTS['coupled_friction'].untestable(lockstep, 2)


def test_payload_changes_require_a_model_with_an_energy():
    motion = clean_motion('six_axis')
    bare = type(motion)(motion.samples, motion.qdd, motion.gravity, motion.gradient,
                        motion.sign_width)
    assert 'potential' in EFFECTS['payload_change'].untestable(bare, 0)
    assert EFFECTS['payload_change'].settings(bare, 0) == []
    assert EFFECTS['base_tilt'].settings(bare, 0) == []


def test_time_is_counted_from_the_start_of_each_run():
    one = JointSamples.single_run(('a',), [5.0, 6.0, 8.0], [[0.0]] * 3, [[0.0]] * 3, [[0.0]] * 3)
    two = JointSamples.single_run(('a',), [100.0, 101.5], [[0.0]] * 2, [[0.0]] * 2, [[0.0]] * 2)
    np.testing.assert_array_equal(run_time(concatenate([one, two])), [0, 1, 3, 0, 1.5])
    part = concatenate([one, two]).select([3, 4])
    np.testing.assert_array_equal(run_time(part), [0, 1.5])


def test_lost_messages_do_not_count_as_noise():
    t = np.arange(0.0, 60.0, 0.02)
    q = 0.5 * np.sin(0.8 * t) + 1e-5 * np.random.default_rng(0).standard_normal(len(t))
    kept = np.random.default_rng(1).random(len(t)) > 0.15
    assert position_noise(q[kept], t[kept]) == pytest.approx(1e-5, rel=0.15)
    # Without times, motion over a gap counts as noise.
    assert position_noise(q[kept]) > 2e-5


def test_all_windows_are_used_if_none_is_even():
    t = np.cumsum(np.tile([0.01, 0.04], 50))
    assert evenly_spaced(t).all() and evenly_spaced(t[:4]).size == 0
