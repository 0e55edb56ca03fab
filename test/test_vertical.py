"""The vertical of arms with known axes, on walls and ceilings."""

from dataclasses import replace

from bench.estimator.mounted import turned
from bench.planning.scenes import known_axes
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import fit_model
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.kinematic.vertical import angle_between, NEAR, on_vertical
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

ARM = iiwa7()
AXES = known_axes(ARM)
MOTION = eq17()
Q = MOTION.q


def recorded(arm, q=Q, seed=0, add=0.0):
    """Return poses with their gravity torque, 0.1 N·m of noise and whatever is added."""
    tau = gravity_torque(arm, q) + add
    tau = tau + 0.1 * np.random.default_rng(seed).standard_normal(tau.shape)
    qd = np.gradient(q, MOTION.t[1], axis=0)
    return JointSamples.single_run(arm.joints, MOTION.t, q, qd, tau)


def moved(arm, motion=MOTION, seed=0):
    """Return the same of the moving arm, with its inertia."""
    return synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed))


def vertical_of(geometry):
    """Return the vertical (3,) in the coordinates of the base that the description has."""
    return (geometry.rotations[0] @ AXES.rotations[0].T)[2]


def truth_of(arm):
    return -arm.model.gravity.linear / np.linalg.norm(arm.model.gravity.linear)


def worst(model, arm):
    q = np.random.default_rng(0).uniform(ARM.lower, ARM.upper, (300, 7))
    return np.sqrt(((model.predict(q) - gravity_torque(arm, q)) ** 2).mean(axis=0)).max()


@settings(max_examples=25, deadline=None)
@given(st.floats(25.0, 180.0), st.floats(0.0, 6.2))
def test_any_vertical_is_found_from_the_torque(angle, about):
    arm = turned(ARM, np.radians(angle), about)
    found = on_vertical(AXES, recorded(arm))
    assert np.degrees(np.arccos(np.clip(vertical_of(found) @ truth_of(arm), -1.0, 1.0))) < 3.0
    # Nothing but the base is turned.
    np.testing.assert_array_equal(found.rotations[1:], AXES.rotations[1:])
    assert found.joints == AXES.joints and found.origins is AXES.origins


@pytest.mark.parametrize('angle', [0.0, 2.0, 10.0])
def test_an_arm_that_stands_nearly_upright_is_left_to_the_fit(angle):
    assert on_vertical(AXES, recorded(turned(ARM, np.radians(angle), 1.0))) is AXES


@pytest.mark.parametrize('moving', [(), (1,), (0, 1), (3,), (4, 5, 6)])
def test_motion_of_few_joints_shows_no_other_vertical(moving):
    q = np.tile([0.3, 0.7, -0.4, 1.1, 0.2, -0.8, 0.5], (len(Q), 1))
    q[:, list(moving)] = Q[:, list(moving)]
    assert on_vertical(AXES, recorded(ARM, q)) is AXES


@pytest.mark.parametrize('joint', range(7))
def test_effects_that_are_not_modelled_turn_no_base(joint):
    spring, rub = np.zeros((2, *Q.shape))
    spring[:, joint] = 5.0 * (Q[:, joint] - Q[:, joint].mean())
    rub[:, joint] = 3.0 * np.sign(np.gradient(Q[:, joint]))
    for effect in (spring, rub, np.sin(3.0 * Q) * (np.arange(7) == joint)):
        assert on_vertical(AXES, recorded(ARM, add=effect)) is AXES


@pytest.mark.parametrize('angle', [45.0, 90.0, 180.0])
def test_gravity_on_a_wall_is_as_good_as_on_a_floor(angle):
    arm = turned(ARM, np.radians(angle), 0.7)
    result = fit(moved(arm), FitOptions(geometry=AXES))
    assert worst(result.model, arm) < 0.1
    assert np.degrees(result.report.base_tilt) == pytest.approx(angle, abs=1.0)
    assert result.report.to_json()['chain']['base_tilt'] == result.report.base_tilt
    first = result.report.warnings[0]
    assert 'tilted by' in first and ('ceiling' in first) == (angle > 135.0)
    assert angle_between(result.model.geometry.rotations, AXES.rotations) > NEAR


@pytest.mark.parametrize('angle', [90.0, 180.0])
def test_a_tool_on_a_ceiling_has_its_own_mass(angle):
    arm, centre = turned(ARM, np.radians(angle), 0.7), (0.02, 0.03, 0.1)
    loaded = with_payload(arm, Payload(2.0, centre))
    later = moved(loaded, eq17(20.0, start=100.0), 1)
    old = fit(moved(arm), FitOptions(geometry=AXES)).model
    # Of a model without axes the vertical is read from its own torque.
    for model in (old, replace(old, geometry=None), fit(moved(arm)).model):
        found = update(model, later, geometry=AXES)
        assert found.report.payload.mass.value == pytest.approx(2.0, abs=0.1)
        assert worst(found.model, loaded) < 0.3


def test_a_short_recording_of_what_is_no_chain_is_fitted_without_known_axes():
    # Balancers, of energy 15 sin(q2) sin(q4), 7.5 cos(2 q2) and 7.5 sin(2 q1): no chain has them.
    balanced = np.zeros_like(Q)
    balanced[:, 0] = 15.0 * np.cos(2.0 * Q[:, 0])
    balanced[:, 1] = 15.0 * (np.cos(Q[:, 1]) * np.sin(Q[:, 3]) - np.sin(2.0 * Q[:, 1]))
    balanced[:, 3] = 15.0 * np.sin(Q[:, 1]) * np.cos(Q[:, 3])
    samples = recorded(ARM, add=balanced).select(np.arange(150))
    result = fit_model(Recording(samples), FitOptions(geometry=AXES))[0]
    # The fits that test whether it has settled have no use for known axes either.
    assert result.model.formulation == 'potential' and result.model.geometry is None
