"""Joints that count their angles from elsewhere than the description of the arm."""

from dataclasses import replace

from bench.estimator.mounted import turned
from bench.planning.scenes import known_axes
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit, FitOptions
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
    """Return poses as encoders with another zero read them, with their gravity torque."""
    tau = gravity_torque(arm, MOTION.q) + add
    tau = tau + 0.1 * np.random.default_rng(seed).standard_normal(tau.shape)
    qd = np.gradient(MOTION.q, MOTION.t[1], axis=0)
    return JointSamples.single_run(arm.joints, MOTION.t, MOTION.q - zero, qd, tau)


def moved(arm=ARM, zero=OFF, motion=MOTION, seed=0):
    """Return the same of the moving arm, with its inertia."""
    samples = synthesise(arm, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed))
    return replace(samples, q=samples.q - zero)


def worst(model, arm=ARM, zero=OFF):
    left = model.predict(RANGE - zero) - gravity_torque(arm, RANGE)
    return np.sqrt((left ** 2).mean(axis=0)).max()


def test_parallel_axes_show_no_zero_angle():
    # tau_1 = 5 cos q1 + 3 cos(q1 + q2 + d) + 2 cos(q1 + q2 + d + q3), d = 0.02 rad: moments of
    # another direction on each link say the same.
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
def test_gravity_is_that_of_the_arm_whatever_its_zero_angles_are(degrees, seed):
    zero = np.radians(degrees)
    found = with_zero_angles(AXES, recorded(zero=zero, seed=seed))
    # Neither the first nor the last one shows.
    turns = zero_angle_differences(AXES.rotations, found.rotations)
    assert turns[0] == turns[6] == 0.0 and same_axes(found, AXES)
    fixed = fit(moved(zero=zero, seed=seed), FitOptions(geometry=AXES))
    assert fixed.model.geometry is not None and worst(fixed.model, zero=zero) < 0.45


@pytest.mark.parametrize('seed', range(10))
def test_an_arm_as_described_is_left_alone(seed):
    assert with_zero_angles(AXES, recorded(seed=seed)) is AXES


@pytest.mark.parametrize('joint', range(7))
def test_effects_that_are_not_modelled_turn_no_joint(joint):
    spring, rub = np.zeros((2, *MOTION.q.shape))
    spring[:, joint] = 5.0 * (MOTION.q[:, joint] - MOTION.q[:, joint].mean())
    rub[:, joint] = 3.0 * np.sign(np.gradient(MOTION.q[:, joint]))
    for effect in (spring, rub, np.sin(3.0 * MOTION.q) * (np.arange(7) == joint)):
        assert with_zero_angles(AXES, recorded(add=effect)) is AXES


@pytest.mark.parametrize('angle', [1.0, 5.0, 15.0])
def test_a_tilt_of_the_base_turns_no_joint(angle):
    assert with_zero_angles(AXES, recorded(turned(ARM, np.radians(angle), 1.0))) is AXES


def test_a_degree_on_every_joint_is_found_and_reported():
    result = fit(moved(), FitOptions(geometry=AXES))
    assert worst(result.model) < 0.15
    assert worst(fit(moved(), FitOptions()).model) > worst(result.model)
    found = result.report.zero_angles
    assert found['iiwa_joint_2'] == pytest.approx(OFF[1], abs=np.radians(0.3))
    assert result.report.to_json()['chain']['zero_angles'] == found
    warning, = (line for line in result.report.warnings if 'zero angles differ' in line)
    assert f'iiwa_joint_2 by {np.degrees(found["iiwa_joint_2"]):.1f}' in warning


def test_fast_motion_is_not_asked_for_zero_angles():
    fast = multisine(0.6 * ARM.lower, 0.6 * ARM.upper, np.full(7, 1.0), 1,
                     MultisineOptions(0.3, 30.0), 30.0, 50.0)
    result = fit(moved(motion=fast), FitOptions(geometry=AXES))
    assert result.report.zero_angles == {}


def test_no_zero_angles_are_reported_where_none_differ():
    result = fit(moved(zero=np.zeros(7)), FitOptions(geometry=AXES))
    assert result.report.zero_angles == {} and result.report.warnings == ()


def test_a_tool_is_weighed_on_the_zero_angles_that_were_found():
    centre = (0.02, 0.03, 0.1)
    loaded = with_payload(ARM, Payload(2.0, centre))
    old = fit(moved(), FitOptions(geometry=AXES)).model
    later = moved(loaded, motion=eq17(20.0, start=100.0), seed=1)
    # The description that comes with the new recording still has its own zero angles.
    found = update(old, later, geometry=AXES)
    assert found.report.payload.mass.value == pytest.approx(2.0, abs=0.1)
    assert worst(found.model, loaded) < 0.3
    np.testing.assert_array_equal(found.model.geometry.rotations, old.geometry.rotations)


def test_the_zero_angles_go_with_the_model_file(tmp_path):
    model = gc.Model(fit(moved(), FitOptions(geometry=AXES)).model)
    gc.save(model, tmp_path / 'arm.json')
    again = gc.load(tmp_path / 'arm.json')
    np.testing.assert_array_equal(again.gravity.geometry.rotations,
                                  model.gravity.geometry.rotations)
    np.testing.assert_array_equal(again.predict(RANGE), model.predict(RANGE))
