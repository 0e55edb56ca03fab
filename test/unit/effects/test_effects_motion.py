"""Motion of a recording: acceleration, direction of motion, and what it does not excite."""

from dataclasses import replace

from bench.shared.effect_motions import (
    arm_of, clean_motion, clean_samples, exact_chain, motion_on, motions_of)
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.runs import run_time
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.excitation import reversals
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import (
    evenly_spaced, laws, refined_laws, speed_noise, white_noise)
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.simulation.disturbances.friction import friction_torque, LuGre
import numpy as np
import pytest

EFFECTS = library_effects()
FRICTION = [name for name, effect in EFFECTS.items() if effect.family == 'friction']


def test_the_gradient_of_a_model_is_that_of_finite_differences():
    rng, step = np.random.default_rng(0), 1e-6
    energy = Expansion(np.array([1, 5, 9, 14, 22, 26]), rng.normal(size=6))
    model = GravityModel.from_energy(('a', 'b', 'c'), 'potential', energy, np.ones(3),
                                     Coverage(-np.ones(3), np.ones(3), 10), {})
    q = rng.uniform(-2, 2, (5000, 3))
    for j in range(3):
        shift = step * np.eye(3)[j]
        slope = (model.predict(q + shift) - model.predict(q - shift)) / (2 * step)
        np.testing.assert_allclose(gravity_gradient(model, q)[:, :, j], slope, atol=1e-6)


def test_acceleration_is_that_of_the_motion():
    samples, truth = clean_samples('iiwa7'), np.concatenate([m.qdd for m in motions_of('iiwa7')])
    # At the start of a pause, acceleration changes within the window.
    assert np.abs(accelerations(samples) - truth).max() < 0.1 * np.abs(truth).max()
    error = accelerations(samples) - truth
    assert np.sqrt((error ** 2).mean()) < 0.02 * np.sqrt((truth ** 2).mean())
    # It is computed within runs.
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
    # Its noise is as documented.
    rng = np.random.default_rng(2)
    qd = 1e-3 * rng.standard_normal((20000, 1))
    samples = JointSamples.single_run(('a',), np.arange(20000) / 50, qd, qd, qd)
    assert accelerations(samples).std() == pytest.approx(0.006, rel=0.1)


def test_poses_at_rest_have_no_acceleration():
    q = np.random.default_rng(0).uniform(-2, 2, (50, 6))
    samples = JointSamples.single_run(arm_of('six_axis').joints, 2.0 * np.arange(50), q,
                                      np.zeros((50, 6)), q)
    motion = motion_on('six_axis', samples)
    assert not motion.qdd.any()
    for name in FRICTION + ['rigid_body_dynamics', 'time_delay']:
        for joint in range(6):
            assert EFFECTS[name].untestable(motion, joint), name
    # Nor has an isolated sample.
    t = np.array([0.0, 0.02, 0.04, 5.0, 9.0, 9.02, 9.04])
    qd = np.linspace(0.1, 0.2, 7)[:, None]
    assert accelerations(JointSamples.single_run(('a',), t, qd, qd, qd))[3, 0] == 0.0


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


def best_law(samples, residual, joint=0):
    """Return the law that explains a residual best, refined, and the remaining deviation."""
    motion = Motion.of(samples, 0 * samples.q, lambda q: q[:, :, None])

    def remaining(law):
        d = motion.direction(joint, law)
        return float((residual - d * (d @ residual) / (d @ d)).std())

    noise = float(motion.speed_noise[joint])
    best = min(laws(noise), key=remaining)
    for step in (1.0, 0.5, 0.25):
        best = min((best, *refined_laws(best, step, noise)), key=remaining)
    return best, remaining(best)


def test_a_width_is_found_in_friction():
    width = 0.006
    samples, _, v, noise = back_and_forth(2e-4)
    law, _ = best_law(samples, np.tanh(v / width) + 0.1 * noise)
    assert law == {'width': pytest.approx(width, rel=0.25)}


def test_a_ramp_is_distinguished_from_a_smooth_sign():
    """Friction of a constraint that yields with speed, as in simulators, is a ramp."""
    samples, _, v, noise = back_and_forth(2e-4)
    law, _ = best_law(samples, np.clip(v / 0.03, -1.0, 1.0) + 0.1 * noise)
    assert law == {'ramp': pytest.approx(0.03, rel=0.15)}
    assert 'width' in best_law(samples, np.tanh(v / 0.015) + 0.1 * noise)[0]


@pytest.mark.parametrize('distance', [3e-4, 0.01])
def test_friction_that_persists_at_rest_is_distinguished(distance):
    samples, q, v, noise = back_and_forth(5e-4)
    bristles = friction_torque(samples.t, q, v, LuGre(1.0, presliding=distance, damping=0.0))
    law, remaining = best_law(samples, bristles + 0.1 * noise)
    assert law == {'distance': pytest.approx(distance, rel=0.35)}
    assert remaining < 0.11
    assert 'distance' not in best_law(samples, np.tanh(v / 0.002) + 0.1 * noise)[0]


def test_laws_are_not_narrower_than_the_noise_of_the_speed():
    for noise in (0.0, 4e-3, 0.02, 0.5):
        grid = laws(noise)
        assert min(law.get('width', np.inf) for law in grid) >= noise
        assert min((law['ramp'] for law in grid if 'ramp' in law), default=1.0) >= noise
        assert any('width' in law for law in grid)
        assert sum('distance' in law for law in grid) == 7


@pytest.mark.parametrize('law', [{'width': 0.0022}, {'ramp': 0.0022}, {'width': 0.04},
                                 {'ramp': 0.11}])
def test_a_refined_law_is_wider_than_the_noise_and_no_viscous_friction(law):
    (name, value), = law.items()
    narrowest, widest = {'width': (0.002, 0.045), 'ramp': (0.0025, 0.12)}[name]
    down, up = (each[name] for each in refined_laws(law, 1.0, 0.002))
    assert down == pytest.approx(max(value / 1.5, narrowest))
    assert up == pytest.approx(min(value * 1.5, widest))


def test_speed_noise_excludes_motion():
    assert speed_noise(back_and_forth(1e-3)[0])[0] == pytest.approx(1e-3, rel=0.1)
    assert speed_noise(back_and_forth(0.0)[0])[0] < 1e-7


def swing(q, qd):
    """Return the motion of the pendulum along q (M,), at 20 Hz."""
    t = np.arange(len(q)) / 20
    samples = JointSamples.single_run(('swing',), t, q[:, None], qd[:, None],
                                      exact_chain('pendulum').torque(q[:, None]))
    return motion_on('pendulum', samples)


LEVEL = np.arctan2(0.1, 0.4)


@pytest.mark.parametrize(('seconds', 'path', 'names', 'reason'), [
    (40.0, lambda t: (0.05 * t + 0.1 * np.sin(0.3 * t), 0.05 + 0.03 * np.cos(0.3 * t)),
     ('coulomb_friction', 'viscous_friction', 'load_dependent_friction', 'friction_drift',
      'presliding_hysteresis'), 'one direction only'),
    (40.0, lambda t: (np.sin(0.15 * t), 0.15 * np.cos(0.15 * t)), ('presliding_hysteresis',),
     'reversals'),
    (60.0, lambda t: (LEVEL + 0.02 * np.sin(t), 0.02 * np.cos(t)), ('load_dependent_friction',),
     'hardly varies'),
    (60.0, lambda t: (LEVEL + 0.02 * np.sin(t), 0.02 * np.cos(t)),
     ('joint_spring', 'cable_stiffness', 'end_stop'), 'travels'),
    (8.0, lambda t: (np.sin(2 * t), 2 * np.cos(2 * t)), ('torque_drift', 'friction_drift'),
     'too short'),
    (15.0, lambda t: (np.sin(t), np.cos(t)), ('payload_change',), 'take 14.9 s')])
def test_an_effect_that_a_motion_does_not_excite_is_untestable(seconds, path, names, reason):
    motion = swing(*path(np.arange(0.0, seconds, 0.05)))
    for name in names:
        assert reason in EFFECTS[name].untestable(motion, 0)
    if reason == 'one direction only':
        assert EFFECTS['joint_spring'].untestable(motion, 0) is None


def test_speed_dependence_is_untestable_at_one_speed():
    leg = np.linspace(0.0, 1.0, 200)
    q = np.concatenate([leg, leg[::-1]] * 3)
    qd = np.where(np.arange(len(q)) // 200 % 2, -0.1, 0.1)
    motion = swing(q, qd)
    assert EFFECTS['coulomb_friction'].untestable(motion, 0) is None
    for name in ('viscous_friction', 'stribeck_friction', 'degressive_friction'):
        assert 'one speed' in EFFECTS[name].untestable(motion, 0)
    assert EFFECTS['asymmetric_friction'].untestable(motion, 0) is None
    assert EFFECTS['presliding_hysteresis'].untestable(motion, 0) is None
    assert reversals(motion, 0) == 5


def test_effects_require_a_chain_several_joints_or_gravity():
    bare = replace(clean_motion('six_axis'), chain=None, geometry=None)
    for name in ('payload_change', 'base_tilt'):
        assert 'requires a serial arm' in EFFECTS[name].untestable(bare, 0)
    assert 'axes of the arm are unknown' in EFFECTS['rigid_body_dynamics'].untestable(bare, 0)
    assert EFFECTS['encoder_offset'].untestable(bare, 1) is None
    motion = clean_motion('pendulum')
    for name in ('coupled_friction', 'tool_force'):
        assert EFFECTS[name].untestable(motion, 0), name
    # Its axis is horizontal: a tilt about the axis itself is an encoder offset.
    reason = EFFECTS['base_tilt'].untestable(clean_motion('pendulum'), 0)
    assert 'no gravity torque depends on a tilt' in reason


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
    assert white_noise([(q[kept], t[kept])]) == pytest.approx(1e-5, rel=0.15)
    # Without times, motion over a gap counts as noise.
    assert white_noise([(q[kept], None)]) > 2e-5
    # All windows are used if none is even.
    t = np.cumsum(np.tile([0.01, 0.04], 50))
    assert evenly_spaced(t, 4).all() and evenly_spaced(t[:4], 4).size == 0
