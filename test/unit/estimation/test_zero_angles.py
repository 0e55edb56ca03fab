"""Zero-angle offsets between encoders and the description of the arm."""

from dataclasses import replace

from bench.planning.scenes import known_axes
from bench.shared.campaign import campaign
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.kinematic.geometry import same_axes
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
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


@pytest.mark.parametrize('seed', [0, *campaign(1, 2, 3)])
def test_gravity_is_accurate_with_any_zero_offsets(seed):
    zero = np.radians(np.random.default_rng(seed).uniform(-4.0, 4.0, 7))
    fixed = fit(moved(zero=zero, seed=seed), FitOptions(geometry=AXES))
    assert fixed.model.geometry is not None and worst(fixed.model, zero=zero) < 0.45
    assert same_axes(fixed.model.geometry, AXES)


@pytest.mark.parametrize('joint', [1, *campaign(3)])
def test_unmodelled_effects_yield_no_offset(joint):
    spring, friction = np.zeros((2, *MOTION.q.shape))
    spring[:, joint] = 5.0 * (MOTION.q[:, joint] - MOTION.q[:, joint].mean())
    friction[:, joint] = 3.0 * np.sign(np.gradient(MOTION.q[:, joint]))
    for effect in (spring, friction):
        assert fit(recorded(add=effect), FitOptions(geometry=AXES)).report.zero_angles == {}


@pytest.fixture(scope='module')
def result():
    """Return the fit of an arm with an offset of a degree on every joint."""
    return fit(moved(), FitOptions(geometry=AXES))


def test_a_degree_on_every_joint_is_estimated_and_reported(result):
    assert worst(result.model) < 0.15
    reported = result.report.zero_angles
    assert reported['iiwa_joint_2'] == pytest.approx(OFF[1], abs=np.radians(0.3))
    assert result.report.to_json()['zero_angles'] == reported
    warning, = (line for line in result.report.warnings if 'zero angles differ' in line)
    assert f'iiwa_joint_2 by {np.degrees(reported["iiwa_joint_2"]):.1f}' in warning


def test_no_zero_angles_are_reported_without_offsets():
    result = fit(moved(zero=np.zeros(7)), FitOptions(geometry=AXES))
    assert result.report.zero_angles == {} and result.report.warnings == ()


def test_a_payload_is_estimated_with_the_corrected_zero_angles(result):
    centre = (0.02, 0.03, 0.1)
    loaded = with_payload(ARM, Payload(2.0, centre))
    old = result.model
    later = moved(loaded, motion=eq17(20.0, start=100.0), seed=1)
    # The description of the new recording is not corrected.
    updated = update(old, later, geometry=AXES)
    assert updated.report.payload.mass.value == pytest.approx(2.0, abs=0.1)
    assert worst(updated.model, loaded) < 0.3
    np.testing.assert_array_equal(updated.model.geometry.rotations, old.geometry.rotations)
