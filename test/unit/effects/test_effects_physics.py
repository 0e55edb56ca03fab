"""Effects of the library against independent physics: Pinocchio, or textbook formulas."""

from dataclasses import replace
import re

from bench.shared.effect_motions import (
    arm_of, clean_motion, least_squares, motion_on, motions_of, NOISE,
    samples_of)
from bench.shared.serial_arms import geometry_of
from gravity_comp_ros.data.runs import run_time
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import denoised_path, presliding_state
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.simulation import arms
from gravity_comp_ros.simulation.disturbances.friction import friction_torque, LuGre
from hypothesis import given, strategies as st
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

EFFECTS = library_effects()


def recorded(name, tau, runs=2):
    """Return a motion without noise whose torque is `tau(arm, motion)`."""
    return motion_on(name, samples_of(arm_of(name), motions_of(name, runs), tau))


def fitted(columns, change):
    """Return coefficients of columns (M, N, K) fitted to a change of torque, and the residual."""
    flat = columns.reshape(change.size, -1)
    solution = np.linalg.lstsq(flat, change.ravel(), rcond=1e-9)[0]
    return solution, change - (flat @ solution).reshape(change.shape)


# A change at the start of the second run, before which there is the torque of `other`.
CHANGE = {'run': 2.0, 'time': 0.0, 'clock': 0.0}


def changed(name, other):
    """Return a motion without noise with the gravity of an arm before the change, `other(q)`."""
    first = motions_of(name, 2)[0]
    return recorded(name, lambda arm, m: other(m.q) if m is first else (
        arms.gravity_torque(arm, m.q)))


def rms(values):
    return np.sqrt((values ** 2).mean(axis=0))


@pytest.mark.parametrize('name', ['iiwa7', 'six_axis'])
@pytest.mark.parametrize('roll, pitch', [(2.0, 0.0), (-1.5, 1.0)])
def test_base_tilt_is_that_of_a_rotated_gravity(name, roll, pitch):
    tilted = arms.with_base_tilt(arm_of(name), np.radians(roll), np.radians(pitch))
    motion = changed(name, lambda q: arms.gravity_torque(tilted, q))
    columns = EFFECTS['base_tilt'].columns(motion, 0, CHANGE)
    change = motion.samples.tau - motion.gravity
    solution, residual = fitted(columns, change)
    assert np.linalg.norm(residual) < 0.05 * np.linalg.norm(change)
    assert np.hypot(*solution) == pytest.approx(np.radians(np.hypot(roll, pitch)), rel=0.02)
    assert not columns[motion.samples.runs == 1].any()


def test_encoder_offset_is_that_of_a_shifted_angle():
    """The true angle is 0.01 rad above the reported one before the change, and then equal."""
    joint, shift = 3, 0.01 * np.eye(7)[3]
    motion = changed('iiwa7', lambda q: arms.gravity_torque(arm_of('iiwa7'), q + shift))
    solution, residual = fitted(EFFECTS['encoder_offset'].columns(motion, joint, CHANGE),
                                motion.samples.tau - motion.gravity)
    assert solution[0] == pytest.approx(-0.01, rel=0.01)
    assert np.abs(residual).max() < 0.02


def test_elasticity_is_that_of_a_deflected_link():
    joint, compliance = 1, 2e-4

    def tau(arm, m):
        q = m.q.copy()
        for _ in range(5):
            q[:, joint] = m.q[:, joint] - compliance * arms.gravity_torque(arm, q)[:, joint]
        return arms.gravity_torque(arm, q)

    motion = recorded('iiwa7', tau)
    solution, residual = fitted(EFFECTS['joint_flexibility'].columns(motion, joint, {}),
                                motion.samples.tau - motion.gravity)
    assert solution[0] == pytest.approx(compliance, rel=0.02)
    assert np.abs(residual).max() < 0.03


def test_time_delay_is_that_of_a_delayed_torque():
    motion = recorded('iiwa7', lambda arm, m: arms.gravity_torque(arm, m.path(m.t - 0.1)[0]))
    for joint in (1, 2, 3):
        columns = EFFECTS['time_delay'].columns(motion, joint, {})
        y = (motion.samples.tau - motion.gravity)[:, joint]
        # The delay of the first samples reaches back before the motion.
        solution = np.linalg.lstsq(columns[40:], y[40:], rcond=None)[0]
        assert solution[0] == pytest.approx(0.1, rel=0.02)


def rigid_body(motion):
    """Return coefficients by symbol of rigid-body dynamics, and the residual, of a motion."""
    effect = EFFECTS['rigid_body_dynamics']
    solution, residual = fitted(effect.columns(motion, 0, {}),
                                motion.samples.tau - motion.gravity)
    symbols = [c.symbol for c in effect.coefficients_of(motion, 0, {})]
    return dict(zip(symbols, solution)), residual


def with_dynamics(name):
    """Return a motion with full dynamics and its exact acceleration."""
    motion = recorded(name, lambda arm, m: arms.inverse_dynamics(arm, m.q, m.qd, m.qdd))
    return replace(motion, qdd=np.concatenate([m.qdd for m in motions_of(name, 2)]))


@pytest.mark.parametrize('name', ['six_axis', 'iiwa7'])
@pytest.mark.parametrize('described', [True, False])
def test_dynamics_of_an_arm_are_those_of_pinocchio(name, described):
    motion = with_dynamics(name)
    if not described:
        motion = replace(motion, geometry=None)
    _, residual = rigid_body(motion)
    dynamic = motion.samples.tau - motion.gravity
    assert np.abs(residual).max() < 1e-6 * np.abs(dynamic).max()


@pytest.mark.parametrize('name', ['iiwa7', 'six_axis'])
def test_payload_is_that_of_a_mass_at_the_last_link(name):
    com = 0.06, -0.04, 0.08
    loaded = arms.with_payload(arm_of(name), arms.Payload(1.5, com))
    # Gravity is that of the end, with the load; before 40 s in the second run there is none.
    motion = recorded(name, lambda arm, m: np.where(
        (m.t < 40.0)[:, None] | (m is motions_of(name, 2)[0]),
        arms.gravity_torque(arm, m.q), arms.gravity_torque(loaded, m.q)))
    motion = replace(motion, gravity=arms.gravity_torque(loaded, motion.samples.q))
    effect, setting = EFFECTS['payload_change'], {'run': 2.0, 'time': 40.0, 'clock': 0.0}
    columns, change = effect.columns(motion, 0, setting), motion.samples.tau - motion.gravity
    solution, residual = fitted(columns, change)
    # Exact: a mass changes the moments alone.
    assert np.abs(residual).max() < 1e-8
    assert not columns[(motion.samples.runs == 1) & (run_time(motion.samples) >= 40.0)].any()
    moments = geometry_of(arm_of(name)).tool_moments()
    by_hand = 1.5 * np.array([1.0, *com]) @ moments
    symbols = [c.symbol for c in effect.coefficients_of(motion, 0, setting)]
    free = np.abs(columns).max(axis=(0, 1)) > 1e-9
    assert len(symbols) == len(solution) == len(by_hand)
    np.testing.assert_allclose((columns @ (solution - by_hand)), 0.0, atol=1e-6)
    assert free.sum() >= 2 * motion.samples.n_joints - 2


def test_a_tool_force_on_a_joint_depends_on_later_joints_alone():
    """Otherwise it would have features of gravity."""
    for each in EFFECTS['tool_force'].coefficients_of(clean_motion('iiwa7'), 0, {}):
        joint, feature = re.fullmatch(r'f_(\d)\[(.*)\]', each.symbol).groups()
        assert all(factor > joint for factor in re.findall(r'[sc](\d)', feature))


def test_tool_force_is_that_of_the_jacobian_on_the_last_joints():
    force = np.array([3.0, -5.0, 8.0])

    def tau(arm, m):
        data = arm.model.createData()
        torques = []
        for q in m.q:
            pin.computeJointJacobians(arm.model, data, q)
            jacobian = pin.getJointJacobian(arm.model, data, arm.n_joints, pin.LOCAL)
            torques.append(-jacobian.T @ np.r_[force, np.cross([0.0, 0.05, 0.12], force)])
        return arms.gravity_torque(arm, m.q) + np.array(torques)

    for name in ('iiwa7', 'six_axis'):
        motion = recorded(name, tau, runs=1)
        n, change = motion.samples.n_joints, motion.samples.tau - motion.gravity
        columns = EFFECTS['tool_force'].columns(motion, 0, {})
        for joint in range(n - 4, n):
            own = columns[:, joint]
            fit = np.linalg.lstsq(own, change[:, joint], rcond=None)[0]
            residual = change[:, joint] - own @ fit
            # The fourth joint from the end has only features of two factors.
            limit = 1e-9 if joint >= n - 3 else 0.25 * rms(change[:, joint])
            assert rms(residual) <= limit, f'{name}, joint {joint + 1}'


def test_presliding_is_the_solution_of_dahls_equation():
    distance = 0.01
    t = np.linspace(0.0, 20.0, 4001)
    q, v = 0.05 * np.sin(t) + 0.01 * np.sin(3.1 * t), 0.05 * np.cos(t) + 0.031 * np.cos(3.1 * t)
    speed = lambda s: 0.05 * np.cos(s) + 0.031 * np.cos(3.1 * s)  # noqa: E731
    ode = solve_ivp(lambda s, z: (speed(s) - abs(speed(s)) * z) / distance, (0.0, 20.0), [0.0],
                    t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.02)
    np.testing.assert_allclose(presliding_state(q, distance), ode.y[0], atol=2e-3)
    bristles = friction_torque(t, q, v, LuGre(1.0, presliding=distance, damping=0.0))
    np.testing.assert_allclose(presliding_state(q, distance), bristles, atol=2e-3)


def test_encoder_noise_does_not_change_the_presliding_state():
    rng = np.random.default_rng(0)
    q = np.concatenate([np.linspace(0.0, 0.1, 500), np.full(3000, 0.1)])
    noisy = q + 3e-5 * rng.standard_normal(len(q))
    assert presliding_state(noisy, 1e-3)[-1] < 0.2
    assert presliding_state(denoised_path(noisy), 1e-3)[-1] > 0.8


def test_ripple_is_found_at_its_own_period():
    effect, motion = EFFECTS['torque_ripple'], clean_motion('iiwa7')
    q, rng = motion.samples.q[:, 3], np.random.default_rng(1)
    y = 0.1 * np.sin(80 * q + 0.4) + NOISE * rng.standard_normal(len(q))
    residual = {}
    for setting in effect.settings(motion, 3):
        columns = effect.columns(motion, 3, setting)
        solution, _ = least_squares(columns, y, NOISE)
        residual[setting['k']] = (((y - columns @ solution) ** 2).sum(), np.hypot(*solution))
    best = min(residual, key=lambda k: residual[k][0])
    assert best == 80 and residual[best][1] == pytest.approx(0.1, rel=0.1)


@given(st.floats(0.0, 1.0), st.floats(1.25, 3.0), st.sampled_from([1.0, -1.0]))
def test_a_cable_pulls_and_stiffens_at_any_angle(hardening, order, side):
    q = np.linspace(-6.0, 6.0, 200)[:, None]
    samples = JointSamples.single_run(('joint',), np.arange(200.0), q, 0.0 * q, 0.0 * q)
    motion = Motion.of(samples, 0.0 * q, lambda q: np.zeros((len(q), 1, 1)))
    pull = EFFECTS['cable_stiffness'].columns(motion, 0, {
        'start': 0.3, 'side': side, 'half': 0.5, 'order': order, 'hardening': hardening})[:, 0]
    assert (side * pull >= 0.0).all() and (pull != 0.0).any()
    stiffness = np.diff(pull)
    assert (stiffness >= 0.0).all()
    assert (side * np.diff(stiffness) >= -1e-12).all()


def test_ranges_of_cables_and_end_stops():
    motion = clean_motion('six_axis')
    q = motion.samples.q[:, 2]
    low, span = q.min(), np.ptp(q)
    stop = EFFECTS['end_stop']
    depths = [abs(setting['start'] - (low + span if setting['side'] > 0 else low)) / span
              for known in stop.settings(motion, 2)
              for setting in (known, *stop.refine(motion, 2, known, 1.0))]
    assert max(depths) <= 0.15 + 1e-9 and min(depths) < 0.02
    cable = EFFECTS['cable_stiffness']
    starts = sorted(
        (setting['start'] - low) / span for known in cable.settings(motion, 2)
        if known['side'] > 0
        for setting in (known, *cable.refine(motion, 2, known, 1.0)))
    # Cables start within the range of stops, in steps of a sixteenth of the travel.
    assert starts[0] < 0.15 and starts[-1] > 0.85 and np.diff(starts).max() < 0.0625


@given(st.integers(0, 10 ** 6), st.sampled_from([1e-6, 1e-5, 1e-4]))
def test_a_denoised_path_has_the_reversals_of_the_joint(seed, noise):
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.uniform(0.02, 0.5, 8) * np.resize([1.0, -1.0], 8))
    # At rest at every reversal, and 2 mrad a sample between.
    parts = [np.concatenate([np.full(40, a), np.linspace(a, b, max(2, round(abs(b - a) / 2e-3)))])
             for a, b in zip(turns, turns[1:])]
    truth = np.concatenate(parts)
    path = denoised_path(truth + noise * rng.standard_normal(len(truth)))
    # The error of the path is that of the encoder, without lag.
    assert np.abs(path - truth).max() < 6.0 * noise
    # At rest the path travels with the noise: 5.8 standard deviations in 99.9 % of draws, 6.2 in
    # the worst of 1500.
    assert np.abs(np.diff(path[:40])).sum() < 8.0 * noise
    way = np.abs(np.diff(turns)).sum()
    assert np.abs(np.diff(path)).sum() == pytest.approx(way, abs=12.0 * noise * len(turns))
