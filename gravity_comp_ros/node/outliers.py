"""
Outliers of an epoch: samples with a transient torque that is not gravity.

An intermittently engaging brake or a push changes the effort of a joint for a few samples. Such
samples are left out of a job and counted per joint. A lasting disagreement is no outlier but a
fault of the joint (`effort_plausibility`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.update import payload_change_weights
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.node.live_nuisance import moving_rms, REST_SPEED
from gravity_comp_ros.node.self_confirmation import SentTorque
import numpy as np

# Largest share of outliers. A larger share means that the model or the effort is wrong.
MAX_SHARE = 0.3


def outliers_of_change(gravity: JointSamples, chain: GravityModel) -> BoolArray:
    """
    Return a mask (M, N) of the torques that are outliers of a change of the chain's moments.

    :param gravity: samples after the change whose torque is gravity.
    :param chain: of the arm before the change.
    """
    return _none_if_too_many(payload_change_weights(chain, gravity) == 0.0)


def outliers_of_fit(residual: FloatArray, samples: JointSamples) -> BoolArray:
    """
    Return a mask (M, N) of the torques that are outliers of a model that was fitted to them.

    At rest friction can have any value, so a joint at rest has no outliers.

    :param residual: residual without friction and offset (M, N), N·m.
    """
    far = robust.huber_weights(residual, floor(samples.tau)) == 0.0
    return _none_if_too_many(far & (np.abs(samples.qd) > REST_SPEED))


def rms_without(samples: JointSamples, predicted: FloatArray) -> FloatArray:
    """
    Return the RMS residual (N,) in N·m of moving joints without outliers.

    :param predicted: gravity, friction and offset of a fitted model (M, N), N·m.
    """
    residual = samples.tau - predicted
    is_outlier = outliers_of_fit(residual, samples)
    return moving_rms(np.where(is_outlier, 0.0, residual), samples.qd)


def counts(names: tuple[str, ...], outliers: BoolArray) -> Mapping[str, int]:
    """Return the number of outliers of each joint that has any."""
    return {name: int(n) for name, n in zip(names, outliers.sum(axis=0)) if n}


def without(samples: JointSamples, outliers: BoolArray) -> JointSamples:
    """Return the samples at which no joint is an outlier."""
    return samples.select(~outliers.any(axis=1))


def sent_without(sent: SentTorque | None, train: BoolArray,
                 held_out: BoolArray) -> SentTorque | None:
    """Return the published torque of the samples at which no joint is an outlier."""
    if sent is None:
        return None
    return replace(sent, train=sent.train[~train.any(axis=1)],
                   held_out=sent.held_out[~held_out.any(axis=1)])


def _none_if_too_many(outliers: BoolArray) -> BoolArray:
    if outliers.any(axis=1).mean() > MAX_SHARE:
        return np.zeros_like(outliers)
    return outliers
