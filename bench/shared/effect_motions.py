"""Motions of arms with 1, 6 and 7 joints, with exact gravity models."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from bench.cases.arms import six_axis
from bench.cases.signals import Pause, with_pauses
from bench.shared.serial_arms import geometry_of
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
from gravity_comp_ros.simulation.arms import (
    Arm, empty_model, gravity_torque, iiwa7, with_base_tilt)
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
import numpy as np
import pinocchio as pin

ARMS = ('pendulum', 'six_axis', 'iiwa7')
RATE, DURATION, NOISE = 20.0, 100.0, 0.05
# Start of the session of all runs on a clock, s.
START = 1.6e9


@cache
def arm_of(name):
    """Return an arm of `ARMS`."""
    return {'pendulum': pendulum, 'six_axis': six_axis, 'iiwa7': iiwa7}[name]()


def pendulum():
    """Return 3 kg, 0.4 m from a horizontal axis."""
    model = empty_model('pendulum')
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), 'swing')
    model.appendBodyToJoint(joint, pin.Inertia(3.0, np.array([0.4, 0.0, 0.1]), 0.02 * np.eye(3)),
                            pin.SE3.Identity())
    return Arm('pendulum', ('swing',), model, np.array([-2.5]), np.array([2.5]), np.array([2.0]))


@cache
def exact_chain(name):
    """
    Return the exact gravity as a chain on the arm's axes.

    Its moments are those of poses on a tilted base: on a level one a moment about a vertical
    first axis does not act.
    """
    arm, (roll, pitch) = arm_of(name), (0.5, 0.3)
    axes = geometry_of(arm).rotations
    tilted = axes.copy()
    tilted[0] = pin.rpy.rpyToMatrix(roll, pitch, 0.0) @ axes[0]
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (60, arm.n_joints))
    columns = ForwardKinematics(tilted, q).moment_columns().transpose(2, 1, 0)
    target = gravity_torque(with_base_tilt(arm, roll, pitch), q)
    moments = np.linalg.lstsq(columns.reshape(target.size, -1), target.ravel(), rcond=1e-9)[0]
    return Chain(axes, moments.reshape(-1, 2))


def gradient_of(chain):
    """Return d torque / d q of a chain, by central differences."""
    return UnknownLengths.of(chain).gradient


def motion_on(name, samples):
    """Return the motion of samples of an arm, with its exact gravity and axes."""
    chain = exact_chain(name)
    return Motion.of(samples, chain.torque(samples.q), gradient_of(chain), chain,
                     geometry_of(arm_of(name)))


def samples_of(arm, motions, tau):
    """Return one run for each motion; `tau` is called with arm and motion."""
    return concatenate([JointSamples.single_run(arm.joints, m.t, m.q, m.qd, tau(arm, m),
                                                f'run {k + 1}')
                        for k, m in enumerate(motions)])


@cache
def motions_of(name, runs=3, rate=RATE):
    """Return multisines with pauses, a different one for each run."""
    arm = arm_of(name)
    options = MultisineOptions(max_speed=0.4, period=DURATION)
    pauses = (Pause(20.0, 4.0), Pause(60.0, 4.0))
    return tuple(with_pauses(multisine(arm.lower, arm.upper, arm.max_speed, seed, options,
                                       DURATION, rate), pauses) for seed in range(runs))


@cache
def clean_samples(name, runs=3):
    """Return samples with gravity and white noise only."""
    rng = np.random.default_rng(5)
    return samples_of(arm_of(name), motions_of(name, runs), lambda arm, m: (
        gravity_torque(arm, m.q) + NOISE * rng.standard_normal(m.q.shape)))


@cache
def clean_motion(name, runs=3):
    """Return the motion of `clean_samples` with the exact gravity."""
    return motion_on(name, clean_samples(name, runs))


@cache
def session_motion(name):
    """Return the same with stamps on one clock, so that its runs are one session."""
    motion = clean_motion(name)
    starts = tuple(START + 1.2 * DURATION * k for k in range(motion.samples.n_runs))
    return replace(motion, samples=replace(motion.samples, starts=starts), memo={})


def base_columns(motion, joint):
    """Return the torque (M, K) of one joint per step of the axes and moments of gravity."""
    key = 'base columns', id(motion.chain), joint
    if key not in motion.memo:
        columns = motion.chain.jacobian(motion.samples.q)[:, joint].T
        motion.memo[key] = columns[:, np.abs(columns).max(axis=0) > 1e-9]
    return motion.memo[key]


def least_squares(columns, y, noise):
    """Return coefficients and their standard errors, for white noise of this size."""
    scale = np.sqrt((columns ** 2).mean(axis=0))
    scaled = columns / scale
    x, *_ = np.linalg.lstsq(scaled, y, rcond=1e-9)
    spread = noise * np.sqrt(np.diag(np.linalg.pinv(scaled.T @ scaled, rcond=1e-9)))
    return x / scale, spread / scale
