"""
Tests whether a payload on the last link can cause a change of the torque.

A body of mass m at the end of an arm adds m times a fixed length to the moment of each link, so
all joints change together. A dead sensor, a wrong sign or another unit changes one joint, or all
of them by one factor. These tests require a chain of the arm before the change (`base_chain`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.live_nuisance import moving_rms, rms
from gravity_comp_ros.node.payload import PayloadLimits
import numpy as np

# Largest residual in units of the noise of earlier epochs. Real payloads reached 1.6 after 100
# samples, broken joints 3 and more (bench/node_acceptance.py).
MAX_RESIDUAL = 2.5
# Minimum deviation of a common factor from 1 for an objection.
MIN_FACTOR_CHANGE = 0.1
# Minimum change of the links beyond the elbow, as a fraction of the largest change.
MIN_OUTER_CHANGE = 0.2
# Standard deviations by which a mass or a reach may exceed its limit.
_SIGNIFICANT = 3.0


@dataclass(frozen=True, eq=False)
class PayloadEvidence:
    """
    The change under test: the arm before (`base`) and after (`loaded`) a change of its moments.

    The change was fitted to `train`; the torque of `train` and `held_out` is gravity. `noise`
    (N,) in N·m is that of earlier epochs.
    """

    base: GravityModel
    loaded: GravityModel
    train: JointSamples
    held_out: JointSamples
    noise: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        return self.train.names

    @property
    def q(self) -> FloatArray:
        return np.concatenate((self.train.q, self.held_out.q))

    @property
    def tau(self) -> FloatArray:
        return np.concatenate((self.train.tau, self.held_out.tau))


def objections(evidence: PayloadEvidence, limits: PayloadLimits,
               geometry: Geometry | None = None) -> Iterator[str]:
    """Yield why no payload can cause the change, the most specific reason first."""
    before = evidence.base.predict(evidence.q)
    axes = axes_under(evidence.base, geometry)
    if axes is not None:
        yield from _known_body(evidence, before, limits, axes)
    else:
        yield from _contradiction(evidence)
        yield from _size(evidence, limits)
        yield from _inner_links_alone(evidence)
    yield from _common_factor(evidence, before)


def axes_under(model: GravityModel, geometry: Geometry | None) -> Geometry | None:
    """Return the axes of a chain, its own or those described; None if it has neither."""
    for axes in (model.geometry, geometry):
        if axes is not None and model.chain is not None and model.joints == axes.joints and (
                np.abs(model.chain.axes[1:] - axes.rotations[1:]).max(initial=0.0) < 1e-6):
            return axes
    return None


def _contradiction(evidence: PayloadEvidence) -> Iterator[str]:
    """Object where one body on the last link does not explain all joints."""
    residual = _residual(evidence)
    ratio = residual / evidence.noise
    worst = int(np.argmax(ratio))
    if ratio[worst] > MAX_RESIDUAL:
        joint, fault = _suspect(evidence)
        yield (f'no payload explains the effort of {evidence.names[worst]}: residual '
               f'{residual[worst]:.3g} N·m, noise of earlier epochs {evidence.noise[worst]:.3g}; '
               f'most likely {evidence.names[joint]} {fault}')


def _size(evidence: PayloadEvidence, limits: PayloadLimits) -> Iterator[str]:
    change = np.hypot(*_moment_change(evidence).T)
    worst = int(np.argmax(change))
    if change[worst] > limits.moment:
        yield (f'the change at {evidence.names[worst]} is {change[worst]:.3g} N·m; the limit is '
               f'{limits.moment:.3g} N·m, by max_payload {limits.mass:g} kg at '
               f'max_payload_reach {limits.reach:g} m')


def _inner_links_alone(evidence: PayloadEvidence) -> Iterator[str]:
    """Object where no link beyond the elbow changes; a body on the last link changes them."""
    n = len(evidence.names)
    moments = _moment_change(evidence)
    outer = moments.copy()
    outer[:(n - 1) // 2] = 0.0
    columns = ForwardKinematics(evidence.loaded.chain.axes,  # type: ignore[union-attr]
                                evidence.q).moment_columns()
    all_links, outer_links = (np.abs(np.tensordot(part.ravel(), columns, axes=(0, 0)).T)
                              / evidence.noise for part in (moments, outer))
    if n > 2 and rms(all_links).max() > 4.0 * MAX_RESIDUAL and (
            rms(outer_links).max() < MIN_OUTER_CHANGE * rms(all_links).max()):
        joint = int(np.argmax(np.hypot(*moments.T)))
        yield (f'only the moment at {evidence.names[joint]} changed; a body on the last link '
               'changes the links beyond the elbow too: a gain of that joint?')


def _common_factor(evidence: PayloadEvidence, before: FloatArray) -> Iterator[str]:
    """Object to a common factor of all joints, which no payload causes."""
    factor = _factor(evidence, before)
    if abs(factor - 1.0) < MIN_FACTOR_CHANGE:
        return
    residual = rms(evidence.tau - factor * before) / evidence.noise
    loaded_joints = rms(before) * abs(factor - 1.0) > 4.0 * evidence.noise
    if residual.max() < 1.5 and loaded_joints.sum() > 1:
        yield (f'the effort of all joints is {factor:.3g} times the earlier one: another unit or '
               'gain, no payload')


def _known_body(evidence: PayloadEvidence, before: FloatArray, limits: PayloadLimits,
                geometry: Geometry) -> Iterator[str]:
    """Fit mass and first moment of a body on known axes, and object if they do not fit."""
    chain = evidence.base.chain
    assert chain is not None
    columns = np.tensordot(geometry.tool_moments(), ForwardKinematics(
        chain.axes, evidence.q).moment_columns(), axes=(1, 0)) / evidence.noise[:, None]
    design = columns.reshape(4, -1)
    target = ((evidence.tau - before) / evidence.noise).T.ravel()
    # The standard deviations of the prior are the limits.
    prior = np.diag([1.0, *3 * [1.0 / limits.reach ** 2]]) / limits.mass ** 2
    covariance = np.linalg.inv(design @ design.T + prior)
    body = covariance @ (design @ target)
    residual = (target - body @ design).reshape(len(evidence.names), -1)
    ratio = np.sqrt((residual ** 2).mean(axis=1))
    worst = int(np.argmax(ratio))
    if ratio[worst] > MAX_RESIDUAL:
        joint, fault = _suspect(evidence)
        yield (f'no body on {geometry.link} explains the effort of {evidence.names[worst]}: '
               f'residual {ratio[worst] * evidence.noise[worst]:.3g} N·m, noise of earlier '
               f'epochs {evidence.noise[worst]:.3g}; most likely {evidence.names[joint]} {fault}')
        return
    mass, sigma = float(body[0]), float(np.sqrt(covariance[0, 0]))
    if abs(mass) > limits.mass + _SIGNIFICANT * sigma:
        yield f'the change is a body of {mass:.3g} kg; max_payload is {limits.mass:g} kg'
    elif abs(mass) > 10.0 * sigma and (
            float(np.linalg.norm(body[1:] / mass)) > limits.reach * (1.0 + _SIGNIFICANT * sigma)):
        yield (f'the change is a body of {mass:.3g} kg at '
               f'{np.linalg.norm(body[1:] / mass):.3g} m from the last joint; '
               f'max_payload_reach is {limits.reach:g} m')


def _suspect(evidence: PayloadEvidence) -> tuple[int, str]:
    """
    Return the joint whose exclusion gives the best fit of a payload, and its probable fault.

    The fault follows from the measured effort and the effort predicted from the other joints.
    """
    chain = evidence.loaded.chain
    assert chain is not None
    n, m = len(evidence.names), len(evidence.q)
    columns = chain.jacobian(evidence.q) / evidence.noise[:, None]
    target = ((evidence.tau - chain.torque(evidence.q)) / evidence.noise).T
    prior = _step_prior(evidence)
    costs, expected = np.full(n, np.inf), np.zeros((n, m))
    for joint in range(n):
        others = np.arange(n) != joint
        design, residual = columns[:, others].reshape(4 * n, -1), target[others].ravel()
        step = np.linalg.solve(np.eye(4 * n) + prior @ (design @ design.T),
                               prior @ (design @ residual))
        error = residual - step @ design
        costs[joint] = float(error @ error)
        expected[joint] = step @ columns[:, joint] * evidence.noise[joint]
    joint = int(np.argmin(costs))
    torque = chain.torque(evidence.q)[:, joint] + expected[joint]
    return joint, _probable_fault(evidence.tau[:, joint], torque)


def _probable_fault(measured: FloatArray, expected: FloatArray) -> str:
    power = float((expected ** 2).sum())
    slope = float((measured * expected).sum()) / power if power > 0.0 else 1.0
    if slope < -0.5:
        return 'has the wrong sign'
    if measured.std() < 0.25 * expected.std():
        return 'is dead or frozen'
    return 'measures the torque of another joint, or has a wrong gain'


def _step_prior(evidence: PayloadEvidence) -> FloatArray:
    """Return the prior covariance (4N, 4N) of a step from the loaded chain."""
    uncertainty = evidence.base.uncertainty
    assert uncertainty is not None
    prior = uncertainty.covariance.copy()
    half = len(prior) // 2
    size = float(np.abs(evidence.tau - evidence.base.predict(evidence.q)).max())
    prior[half:, half:] += np.eye(half) * size ** 2
    return prior


def _factor(evidence: PayloadEvidence, before: FloatArray) -> float:
    """Return the common factor of all joints from the old gravity to the effort."""
    weighted, measured = before / evidence.noise, evidence.tau / evidence.noise
    return float((weighted * measured).sum() / max(float((weighted ** 2).sum()), 1e-30))


def _residual(evidence: PayloadEvidence) -> FloatArray:
    """Return the larger RMS residual (N,) of the two sets, N·m."""
    return np.maximum(*(moving_rms(part.tau - evidence.loaded.predict(part.q), part.qd)
                        for part in (evidence.train, evidence.held_out)))


def _moment_change(evidence: PayloadEvidence) -> FloatArray:
    old, new = evidence.base.chain, evidence.loaded.chain
    assert old is not None and new is not None
    # Moments are compared in link frames. The axis of an unloaded link is not identifiable, and
    # its estimate rotates when a load appears beyond it.
    return new.moments - old.moments
