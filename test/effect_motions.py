"""Motions of arms with 1, 6 and 7 joints, with exact gravity models."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

from bench.cases.pauses import Pause, with_pauses
from bench.cases.six_axis import six_axis
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.simulation.arms import Arm, gravity_torque, iiwa7
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
import numpy as np
import pinocchio as pin
from serial_arms import geometry_of

ARMS = ('pendulum', 'six_axis', 'iiwa7')
RATE, DURATION, NOISE = 20.0, 100.0, 0.05


@cache
def arm_of(name):
    """Return an arm of `ARMS`."""
    return {'pendulum': pendulum, 'six_axis': six_axis, 'iiwa7': iiwa7}[name]()


def pendulum():
    """Return 3 kg, 0.4 m from a horizontal axis."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), 'swing')
    model.appendBodyToJoint(joint, pin.Inertia(3.0, np.array([0.4, 0.0, 0.1]), 0.02 * np.eye(3)),
                            pin.SE3.Identity())
    return Arm('pendulum', ('swing',), model, np.array([-2.5]), np.array([2.5]), np.array([2.0]))


def potential_energy(arm, q):
    """Return U (M,) in J, by Pinocchio."""
    data = arm.model.createData()
    return np.array([pin.computePotentialEnergy(arm.model, data, pose) for pose in q])


@cache
def exact_model(name):
    """
    Return the exact gravity model.

    In each joint U is a + b sin q + c cos q, so three angles per joint determine all 3^N weights.
    """
    arm, angles = arm_of(name), 2 * np.pi * np.arange(3) / 3
    n = arm.n_joints
    poses = angles[np.array(list(product(range(3), repeat=n)))]
    weights = potential_energy(arm, poses).reshape((3,) * n)
    to_weights = np.linalg.inv(np.column_stack([np.ones(3), np.sin(angles), np.cos(angles)]))
    for axis in range(n):
        weights = np.moveaxis(np.tensordot(to_weights, weights, (1, axis)), 0, axis)
    flat = weights.ravel()
    flat[0] = 0.0
    kept = np.flatnonzero(np.abs(flat) > 1e-9)
    energy = Expansion(kept, flat[kept])
    model = GravityModel.from_energy(arm.joints, 'potential', energy, np.full(n, NOISE),
                                     Coverage(arm.lower, arm.upper, 1000), {})
    return replace(model, geometry=geometry_of(arm))


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
    """Return the motion of `clean_samples` with the exact model."""
    return build_motion(clean_samples(name, runs), exact_model(name))


def base_columns(motion, joint):
    """Return the torque columns (M, K) of the energy's features for one joint."""
    energy, n = motion.model.energy, motion.samples.n_joints
    one = [Expansion(energy.indices[[k]], np.ones(1)).gradient(n, joint)
           for k in range(len(energy.indices))]
    features = np.unique(np.concatenate([part.indices for part in one]))
    if not len(features):
        return np.zeros((motion.samples.n_samples, 0))
    return dictionary.columns(motion.samples.q, features)


def least_squares(columns, y, noise):
    """Return coefficients and their standard errors, for white noise of this size."""
    scale = np.sqrt((columns ** 2).mean(axis=0))
    scaled = columns / scale
    x, *_ = np.linalg.lstsq(scaled, y, rcond=1e-9)
    spread = noise * np.sqrt(np.diag(np.linalg.pinv(scaled.T @ scaled, rcond=1e-9)))
    return x / scale, spread / scale
