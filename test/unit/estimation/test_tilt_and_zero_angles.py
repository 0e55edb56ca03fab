"""Tilt, vertical and zero angles of arms with known axes: estimated if present, and only then."""

from dataclasses import replace
from functools import cache

from bench.shared.campaign import campaign
from bench.shared.serial_arms import geometry_of
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.kinematic.geometry import same_axes
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.vertical import (
    base_tilt_angle, MAX_FITTED_TILT, with_estimated_vertical)
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import (
    gravity_torque, iiwa7, Payload, with_base_tilt, with_payload)
from gravity_comp_ros.simulation.motions import eq17
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
from hypothesis import example, given, settings, strategies as st
import numpy as np
import pinocchio as pin
import pytest

ARM = iiwa7()
AXES = geometry_of(ARM)


def moved(seed, speed, band, arm=ARM, rate=50.0, noise=0.1):
    """Return a minute of a multisine, up to `speed` rad/s and `band` Hz."""
    motion = motions.multisine(0.6 * ARM.lower, 0.6 * ARM.upper, np.full(7, speed), seed,
                               motions.MultisineOptions(speed, 60.0, band), 60.0, rate)
    return motion, synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, noise), seed))


def fitted(samples):
    """Return the result of the fit command, of the samples that pass the gate."""
    return fit_model(Recording(samples), FitOptions('chain', geometry=AXES))[0]


def range_errors(model, arm, zero=0.0):
    """Return the RMS error of each joint over the whole range, N·m."""
    q = np.random.default_rng(0).uniform(ARM.lower, ARM.upper, (300, 7))
    return np.sqrt(((model.predict(q - zero) - gravity_torque(arm, q)) ** 2).mean(axis=0))


def worst(model, arm=ARM, zero=0.0):
    return range_errors(model, arm, zero).max()


@pytest.mark.parametrize('seed', [0, *campaign(2, 3)])
def test_inertia_does_not_appear_as_a_tilt(seed):
    result = fitted(moved(seed, 0.15, 0.3)[1])
    assert result.report.base_tilt == 0.0
    assert worst(result.model) < 0.3


@pytest.mark.parametrize('tilt', [2.0, *campaign(1.0, 5.0, 12.0)])
def test_a_tilt_is_identified(tilt):
    arm = with_base_tilt(ARM, 0.8 * np.radians(tilt), 0.6 * np.radians(tilt))
    result = fit(following(arm), FitOptions('chain', geometry=AXES))
    assert np.degrees(result.report.base_tilt) == pytest.approx(tilt, abs=0.15)
    assert worst(result.model, arm) < 0.3


def test_a_model_of_a_tilted_arm_is_updated_with_a_level_description():
    """The model has no description; that of the update must get its tilt, below 20 degrees."""
    arm = with_base_tilt(ARM, *(np.radians(3.0) * np.array([0.8, 0.6])))
    model = fit(moved(3, 0.15, 0.3, arm, rate=5.0)[1]).model
    loaded = with_payload(arm, Payload(2.0))
    result = update(model, moved(4, 0.1, 0.1, loaded, rate=5.0)[1], geometry=AXES)
    assert result.report.payload.mass.value == pytest.approx(2.0, abs=0.1)
    assert worst(result.model, loaded) < 0.5


def test_uneven_motion_uses_accelerations_of_the_whole_recording():
    motion, samples = moved(0, 0.15, 0.6)
    slow = Recording(samples).slow
    rows = np.searchsorted(samples.t, slow.t)
    own = accelerations(replace(slow, qdd=None))
    off, own_off = (np.abs(qdd - motion.qdd[rows]).max() for qdd in (slow.qdd, own))
    assert off < 0.005 and own_off > 0.02
    # A slow rate does not resolve them.
    assert Recording(replace(slow, qdd=None)).slow.qdd is None


MOTION = eq17(rate=2.5)
Q = MOTION.q


def held(arm=ARM, q=Q, seed=0, add=0.0):
    """Return poses with gravity torque, 0.1 N·m of noise and an added torque."""
    tau = gravity_torque(arm, q) + add
    tau = tau + 0.1 * np.random.default_rng(seed).standard_normal(tau.shape)
    qd = np.gradient(q, MOTION.t[1], axis=0)
    return JointSamples.single_run(arm.joints, MOTION.t, q, qd, tau)


def problem_of(*args, **kwargs):
    return Problem.of(held(*args, **kwargs))


def following(arm=ARM, motion=MOTION, seed=0, zero=0.0):
    """Return samples of the moving arm, including its inertia, with other zero angles (N,)."""
    samples = synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed))
    return replace(samples, q=samples.q - zero)


@cache
def mounted(angle):
    """Return an arm tilted by `angle` degrees, and its fit with known axes."""
    arm = tilted(ARM, np.radians(angle), 0.7)
    return arm, fit(following(arm), FitOptions(geometry=AXES))


def tilted(arm, angle, azimuth):
    """Return the arm with its base rotated by an angle about a horizontal axis, both in rad."""
    # R = Ry(pitch) Rx(roll) gives the same vertical; a rotation about it does not change gravity.
    up = pin.exp3(angle * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))[2]
    roll, pitch = np.arctan2(up[1], up[2]), np.arctan2(-up[0], np.hypot(up[1], up[2]))
    return with_base_tilt(arm, float(roll), float(pitch))


def vertical_of(geometry):
    """Return the vertical (3,) in the described base frame."""
    return (geometry.rotations[0] @ AXES.rotations[0].T)[2]


def truth_of(arm):
    return -arm.model.gravity.linear / np.linalg.norm(arm.model.gravity.linear)


@settings(max_examples=5)
@given(st.floats(25.0, 180.0), st.floats(0.0, 6.2))
# The moment about the nearly vertical first axis is then hardly identifiable.
@example(179.0, 0.03125)
def test_any_vertical_is_estimated_from_the_torque(angle, about):
    arm = tilted(ARM, np.radians(angle), about)
    estimated = with_estimated_vertical(AXES, problem_of(arm))
    assert np.degrees(np.arccos(np.clip(vertical_of(estimated) @ truth_of(arm), -1.0, 1.0))) < 3.0
    # Only the base is rotated.
    np.testing.assert_array_equal(estimated.rotations[1:], AXES.rotations[1:])
    assert estimated.joints == AXES.joints and estimated.origins is AXES.origins


@pytest.mark.parametrize('angle', [0.0, 10.0])
def test_a_small_tilt_is_left_to_the_fit(angle):
    assert with_estimated_vertical(AXES, problem_of(tilted(ARM, np.radians(angle), 1.0))) is AXES


@pytest.mark.parametrize('joint', [1, *campaign(0, 2, 3, 4, 5, 6)])
def test_unmodelled_effects_yield_no_other_vertical(joint):
    spring, friction = np.zeros((2, *Q.shape))
    spring[:, joint] = 5.0 * (Q[:, joint] - Q[:, joint].mean())
    friction[:, joint] = 3.0 * np.sign(np.gradient(Q[:, joint]))
    for effect in (spring, friction, np.sin(3.0 * Q) * (np.arange(7) == joint)):
        assert with_estimated_vertical(AXES, problem_of(ARM, add=effect)) is AXES


@pytest.mark.parametrize('angle', [180.0, *campaign(45.0, 90.0)])
def test_gravity_on_a_wall_is_as_accurate_as_on_a_floor(angle):
    arm, result = mounted(angle)
    # This motion hardly turns the first joint, whose moments matter on a wall.
    error = range_errors(result.model, arm)
    assert error[0] < 0.35 and error[1:].max() < 0.12
    assert np.degrees(result.report.base_tilt) == pytest.approx(angle, abs=1.0)
    assert result.report.to_json()['base_tilt'] == result.report.base_tilt
    first = result.report.warnings[0]
    assert 'tilted by' in first and ('ceiling' in first) == (angle > 135.0)
    assert base_tilt_angle(result.model.geometry.rotations, AXES.rotations) > MAX_FITTED_TILT


@pytest.mark.parametrize('angle', [180.0, *campaign(90.0)])
def test_a_payload_on_a_ceiling_has_the_right_mass(angle):
    arm, result = mounted(angle)
    loaded = with_payload(arm, Payload(2.0, (0.02, 0.03, 0.1)))
    later = following(loaded, eq17(20.0, start=100.0), 1)
    old = result.model
    # For a model without axes the vertical is estimated from the torque of the model.
    for model in (old, replace(old, geometry=None), fit(following(arm)).model):
        updated = update(model, later, geometry=AXES)
        assert updated.report.payload.mass.value == pytest.approx(2.0, abs=0.1)
        assert worst(updated.model, loaded) < 0.3


OFF = np.radians([1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0])


@pytest.mark.parametrize('seed', [0, *campaign(1, 2, 3)])
def test_gravity_is_accurate_with_any_zero_offsets(seed):
    zero = np.radians(np.random.default_rng(seed).uniform(-4.0, 4.0, 7))
    fixed = fit(following(zero=zero, seed=seed), FitOptions(geometry=AXES))
    assert fixed.model.geometry is not None and worst(fixed.model, zero=zero) < 0.45
    assert same_axes(fixed.model.geometry, AXES)


@pytest.mark.parametrize('joint', [1, *campaign(3)])
def test_unmodelled_effects_yield_no_offset(joint):
    spring, friction = np.zeros((2, *MOTION.q.shape))
    spring[:, joint] = 5.0 * (MOTION.q[:, joint] - MOTION.q[:, joint].mean())
    friction[:, joint] = 3.0 * np.sign(np.gradient(MOTION.q[:, joint]))
    for effect in (spring, friction):
        assert fit(held(add=effect), FitOptions(geometry=AXES)).report.zero_angles == {}


@pytest.fixture(scope='module')
def off_by_a_degree():
    """Return the fit of an arm with an offset of a degree on every joint."""
    return fit(following(zero=OFF), FitOptions(geometry=AXES))


def test_a_degree_on_every_joint_is_estimated_and_reported(off_by_a_degree):
    assert worst(off_by_a_degree.model, zero=OFF) < 0.15
    reported = off_by_a_degree.report.zero_angles
    assert reported['iiwa_joint_2'] == pytest.approx(OFF[1], abs=np.radians(0.3))
    assert off_by_a_degree.report.to_json()['zero_angles'] == reported
    warning, = (line for line in off_by_a_degree.report.warnings if 'zero angles differ' in line)
    assert f'iiwa_joint_2 by {np.degrees(reported["iiwa_joint_2"]):.1f}' in warning


def test_a_payload_is_estimated_with_the_corrected_zero_angles(off_by_a_degree):
    centre = (0.02, 0.03, 0.1)
    loaded = with_payload(ARM, Payload(2.0, centre))
    old = off_by_a_degree.model
    later = following(loaded, motion=eq17(20.0, start=100.0), seed=1, zero=OFF)
    # The description of the new recording is not corrected.
    updated = update(old, later, geometry=AXES)
    assert updated.report.payload.mass.value == pytest.approx(2.0, abs=0.1)
    assert worst(updated.model, loaded, OFF) < 0.3
    np.testing.assert_array_equal(updated.model.geometry.rotations, old.geometry.rotations)
