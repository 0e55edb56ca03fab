"""Start of the axes: what gravity does not determine follows from the torque of motion."""

from bench.shared.campaign import campaign
from bench.shared.rough_links import two_links
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.regression.linear import with_common_terms
from gravity_comp_ros.regression.noise import noise_std
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import start_axes
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
from gravity_comp_ros.simulation import arms
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = arms.iiwa7()
NOISE = 0.01  # N·m


def recorded(seed, seconds=60.0):
    """Return slow motion in half of the range, with full dynamics and white noise."""
    middle, half = np.array([0.0, 0.6, 0.0, -1.2, 0.0, 0.8, 0.0]), np.full(7, 0.7)
    motion = multisine(middle - half, middle + half, ARM.max_speed, seed,
                       MultisineOptions(0.4, seconds, 0.1, 4), seconds, 50.0)
    exact = synthesise(ARM, motion, SynthesisOptions())
    tau = exact.tau + NOISE * np.random.default_rng(seed).standard_normal(exact.tau.shape)
    return JointSamples.single_run(ARM.joints, exact.t, exact.q, exact.qd, tau)


@pytest.mark.parametrize('seed', [0, *campaign(1, 2, 3, 4, 5)])
def test_a_vertical_first_axis_turns_as_the_torque_of_motion_says(seed):
    problem = Problem.of(recorded(seed))
    start = start_axes(problem, ())
    errors = []
    for chain in (start.chain, start.chain.with_first_reversed()):
        fit = with_common_terms(problem, UnknownLengths.of(chain), ())
        errors.append(noise_std(fit.posterior, problem.scale, problem.options)
                      / problem.white_noise)
    assert errors[0].max() < 1.3
    assert errors[1][0] > 2.0 * errors[0][0]


def test_gravity_does_not_depend_on_the_direction_of_a_vertical_axis():
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    axes *= np.sign(np.linalg.det(axes))[:, None, None]
    axes[0] = np.eye(3)
    chain, q = Chain(axes, rng.normal(size=(4, 2))), rng.uniform(-3.0, 3.0, (20, 4))
    other = chain.with_first_reversed()
    np.testing.assert_allclose(other.torque(q), chain.torque(q), atol=1e-12)
    np.testing.assert_allclose(other.with_first_reversed().moments, chain.moments)


@pytest.mark.parametrize('seed', [4, 7, 10, *campaign(12, 14, 19)])
def test_a_short_recording_has_a_start(seed):
    """A white minimum that equals one of a search before must not be dropped with that."""
    problem = Problem.of(two_links(seed, 240))
    gravity = start_axes(problem, ()).gravity(problem.samples.q)
    assert np.isfinite(gravity).all() and np.ptp(gravity) > 1.0
