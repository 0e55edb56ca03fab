"""
Samples of an epoch at which something else than gravity acted for a moment.

A brake that grips or a hand that pushes makes the effort of a joint jump for a few samples. They
are left out of a job, counted and named. What lasts longer is no outlier: a quarter of the samples
of a joint that disagree with the others is a fault of that joint (`absolute_tests`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.update import payload_change_weights
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.node.live_friction import moving_rms, STANDSTILL
from gravity_comp_ros.node.self_confirmation import Sent
import numpy as np

# A larger share of the samples is no outlier: the model is wrong, or the effort is.
MOST = 0.3


def outliers_of_change(gravity: JointSamples, chain: GravityModel) -> BoolArray:
    """
    Return which torques (M, N) no change of the chain's moments explains beside the others.

    :param gravity: samples whose torque is gravity, after the change.
    :param chain: of the arm before the change.
    """
    return _unless_many(payload_change_weights(chain, gravity) == 0.0)


def outliers_of_fit(residual: FloatArray, samples: JointSamples) -> BoolArray:
    """
    Return which torques (M, N) a model that was fitted to them leaves as outliers.

    At rest friction can have any value, so a joint at rest has no outliers.

    :param residual: what gravity, friction and offset leave (M, N), N·m.
    """
    far = robust.huber_weights(residual, floor(samples.tau)) == 0.0
    return _unless_many(far & (np.abs(samples.qd) > STANDSTILL))


def rms_without(samples: JointSamples, predicted: FloatArray) -> FloatArray:
    """
    Return the RMS (N,) in N·m of what is left of moving joints, without outliers.

    Two samples at which an arm sets out with a jerk are no reason to call its effort broken.

    :param predicted: gravity, friction and offset of a model that was fitted (M, N), N·m.
    """
    residual = samples.tau - predicted
    few = outliers_of_fit(residual, samples)
    return moving_rms(np.where(few, 0.0, residual), samples.qd)


def counts(names: tuple[str, ...], outliers: BoolArray) -> Mapping[str, int]:
    """Return how many samples of each joint are outliers, joints without any left out."""
    return {name: int(n) for name, n in zip(names, outliers.sum(axis=0)) if n}


def without(samples: JointSamples, outliers: BoolArray) -> JointSamples:
    """Return the samples at which no joint is an outlier."""
    return samples.select(~outliers.any(axis=1))


def sent_without(sent: Sent | None, train: BoolArray, held: BoolArray) -> Sent | None:
    """Return the published torque of the same samples."""
    if sent is None:
        return None
    return replace(sent, train=sent.train[~train.any(axis=1)], held=sent.held[~held.any(axis=1)])


def _unless_many(outliers: BoolArray) -> BoolArray:
    if outliers.any(axis=1).mean() > MOST:
        return np.zeros_like(outliers)
    return outliers
