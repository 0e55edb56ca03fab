"""Zero-angle offsets between encoders and the description of the arm."""

from dataclasses import replace

from bench.estimator.mounted import tilted
from bench.planning.scenes import known_axes
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.kinematic.zero_angles import (
    same_axes, with_zero_angles, zero_angle_differences)
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17, multisine, MultisineOptions
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

ARM = iiwa7()
AXES = known_axes(ARM)
MOTION = eq17()
OFF = np.radians([1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
RANGE = np.random.default_rng(0).uniform(ARM.lower, ARM.upper, (300, 7))


def recorded(arm=ARM, zero=0.0, add=0.0, seed=0):
    """Return encoder readings with a zero offset, with gravity torque and 0.1 N·m of noise."""
    tau = gravity_torque(arm, MOTION.q) + add
    tau = tau + 0.1 * np.random.default_rng(seed).standard_normal(tau.shape)
    qd = np.gradient(MOTION.q, MOTION.t[1], axis=0)
    return JointSamples.single_run(arm.joints, MOTION.t, MOTION.q - zero, qd, tau)


def moved(arm=ARM, zero=OFF, motion=MOTION, seed=0):
    """Return samples of the moving arm, including its inertia."""
    samples = synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed))
    return replace(samples, q=samples.q - zero)


def worst(model, arm=ARM, zero=OFF):
    error = model.predict(RANGE - zero) - gravity_torque(arm, RANGE)
    return np.sqrt((error ** 2).mean(axis=0)).max()


def test_offsets_of_parallel_axes_are_not_identifiable():
    # tau_1 = 5 cos q1 + 3 cos(q1 + q2 + d) + 2 cos(q1 + q2 + d + q3), d = 0.02 rad: it is
    # equivalent to a rotation of each link's moment.
    rng, d = np.random.default_rng(1), 0.02
    q = rng.uniform(-1.5, 1.5, (200, 3))
    parts = np.stack([5.0 * np.cos(q[:, 0]), 3.0 * np.cos(q[:, 0] + q[:, 1] + d),
                      2.0 * np.cos(q.sum(axis=1) + d)], axis=1)
    tau = np.cumsum(parts[:, ::-1], axis=1)[:, ::-1] + rng.normal(scale=0.002, size=q.shape)
    axes = replace(AXES, joints=('a', 'b', 'c'), rotations=np.stack(
        [np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.eye(3), np.eye(3)]),
        origins=np.zeros((3, 3)))
    samples = JointSamples.single_run(('a', 'b', 'c'), np.arange(200.0), q, np.zeros_like(q), tau)
    assert with_zero_angles(axes, samples) is axes


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(-4.0, 4.0), min_size=7, max_size=7), st.integers(0, 9))
def test_gravity_is_accurate_with_any_zero_offsets(degrees, seed):
    zero = np.radians(degrees)
    corrected = with_zero_angles(AXES, recorded(zero=zero, seed=seed))
    # The offsets of the first and the last joint are not identifiable.
    differences = zero_angle_differences(AXES.rotations, corrected.rotations)
    assert differences[0] == differences[6] == 0.0 and same_axes(corrected, AXES)
    fixed = fit(moved(zero=zero, seed=seed), FitOptions(geometry=AXES))
    assert fixed.model.geometry is not None and worst(fixed.model, zero=zero) < 0.45


@pytest.mark.parametrize('seed', range(10))
def test_an_arm_as_described_is_unchanged(seed):
    assert with_zero_angles(AXES, recorded(seed=seed)) is AXES


@pytest.mark.parametrize('joint', range(7))
def test_unmodelled_effects_yield_no_offset(joint):
    spring, friction = np.zeros((2, *MOTION.q.shape))
    spring[:, joint] = 5.0 * (MOTION.q[:, joint] - MOTION.q[:, joint].mean())
    friction[:, joint] = 3.0 * np.sign(np.gradient(MOTION.q[:, joint]))
    for effect in (spring, friction, np.sin(3.0 * MOTION.q) * (np.arange(7) == joint)):
        assert with_zero_angles(AXES, recorded(add=effect)) is AXES


@pytest.mark.parametrize('angle', [1.0, 5.0, 15.0])
def test_a_base_tilt_yields_no_offset(angle):
    assert with_zero_angles(AXES, recorded(tilted(ARM, np.radians(angle), 1.0))) is AXES


def test_a_degree_on_every_joint_is_estimated_and_reported():
    result = fit(moved(), FitOptions(geometry=AXES))
    assert worst(result.model) < 0.15
    assert worst(fit(moved(), FitOptions()).model) > worst(result.model)
    reported = result.report.zero_angles
    assert reported['iiwa_joint_2'] == pytest.approx(OFF[1], abs=np.radians(0.3))
    assert result.report.to_json()['chain']['zero_angles'] == reported
    warning, = (line for line in result.report.warnings if 'zero angles differ' in line)
    assert f'iiwa_joint_2 by {np.degrees(reported["iiwa_joint_2"]):.1f}' in warning


def test_zero_angles_are_not_estimated_from_fast_motion():
    fast = multisine(0.6 * ARM.lower, 0.6 * ARM.upper, np.full(7, 1.0), 1,
                     MultisineOptions(0.3, 30.0), 30.0, 50.0)
    result = fit(moved(motion=fast), FitOptions(geometry=AXES))
    assert result.report.zero_angles == {}


def test_no_zero_angles_are_reported_without_offsets():
    result = fit(moved(zero=np.zeros(7)), FitOptions(geometry=AXES))
    assert result.report.zero_angles == {} and result.report.warnings == ()


def test_a_payload_is_estimated_with_the_corrected_zero_angles():
    centre = (0.02, 0.03, 0.1)
    loaded = with_payload(ARM, Payload(2.0, centre))
    old = fit(moved(), FitOptions(geometry=AXES)).model
    later = moved(loaded, motion=eq17(20.0, start=100.0), seed=1)
    # The description of the new recording is not corrected.
    updated = update(old, later, geometry=AXES)
    assert updated.report.payload.mass.value == pytest.approx(2.0, abs=0.1)
    assert worst(updated.model, loaded) < 0.3
    np.testing.assert_array_equal(updated.model.geometry.rotations, old.geometry.rotations)


def test_the_model_file_includes_the_zero_angles(tmp_path):
    model = gc.Model(fit(moved(), FitOptions(geometry=AXES)).model)
    gc.save(model, tmp_path / 'arm.json')
    again = gc.load(tmp_path / 'arm.json')
    np.testing.assert_array_equal(again.gravity.geometry.rotations,
                                  model.gravity.geometry.rotations)
    np.testing.assert_array_equal(again.predict(RANGE), model.predict(RANGE))
