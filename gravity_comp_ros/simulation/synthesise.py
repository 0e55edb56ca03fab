"""Synthesis of joint samples from arm, motion, payload, disturbances and measurement noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import (
    Arm, gravity_torque, inverse_dynamics, Payload, with_payload)
from gravity_comp_ros.simulation.motions import Motion
import numpy as np


@dataclass(frozen=True)
class NoiseOptions:
    """
    Gaussian torque noise.

    `relative` is a standard deviation as a fraction of |tau| (0.01 for the paper's
    N(0, 0.01 tau)); `absolute` is one in N·m.

    :raises OptionError: if a value is negative or not finite.
    """

    relative: float = 0.0
    absolute: float = 0.0

    def __post_init__(self) -> None:
        for field in ('relative', 'absolute'):
            value = getattr(self, field)
            if not np.isfinite(value) or value < 0:
                raise OptionError(f'noise: {field} is {value}; it must be 0 or more')


@dataclass(frozen=True, eq=False)
class Signals:
    """Sensor signals of the arm: `q`, `qd`, `tau` (M, N) in rad, rad/s and N·m."""

    q: FloatArray
    qd: FloatArray
    tau: FloatArray


class Disturbance(Protocol):
    """A deviation from the rigid arm that changes the sensor signals."""

    def apply(self, signals: Signals, motion: Motion, arm: Arm) -> Signals:
        """
        Return the signals with this disturbance.

        :param signals: with the earlier disturbances, without noise.
        :param motion: the true motion; its path allows integration in finer steps.
        """


@dataclass(frozen=True)
class SynthesisOptions:
    """
    Options of the synthesised torque.

    With `static` the torque is that of the arm at rest at every sample, and the reported velocity
    is 0. A `payload` is attached from the beginning, or from `payload_at` s on the motion's clock.
    `disturbances` act in their order, then `noise` of a `seed` is added.
    """

    noise: NoiseOptions = NoiseOptions()
    seed: int = 0
    static: bool = False
    payload: Payload | None = None
    payload_at: float | None = None
    disturbances: Sequence[Disturbance] = ()

    def __post_init__(self) -> None:
        if self.payload_at is not None and self.payload is None:
            raise OptionError('a time to attach the payload needs a payload')


def synthesise(arm: Arm, motion: Motion, options: SynthesisOptions = SynthesisOptions(),
               label: str | None = None) -> JointSamples:
    """
    Return one run of samples of the arm on this motion.

    :raises OptionError: if the numbers of joints of motion and arm differ.
    """
    if motion.n_joints != arm.n_joints:
        raise OptionError(
            f'motion {motion.name} is for {motion.n_joints} joints and {arm.name} has '
            f'{arm.n_joints}; random poses and multisines fit every arm')
    qd = np.zeros_like(motion.qd) if options.static else motion.qd
    signals = Signals(motion.q, qd, rigid_torque(arm, motion, options))
    for disturbance in options.disturbances:
        signals = disturbance.apply(signals, motion, arm)
    noise = np.random.default_rng(np.random.SeedSequence(options.seed).spawn(1)[0])
    tau = signals.tau
    # A torque of exactly 0 has no relative noise.
    tau = (tau + options.noise.relative * np.abs(tau) * noise.standard_normal(tau.shape)
           + options.noise.absolute * noise.standard_normal(tau.shape))
    return JointSamples.single_run(
        arm.joints, motion.t, signals.q, signals.qd, tau, label or motion.name)


def rigid_torque(arm: Arm, motion: Motion, options: SynthesisOptions) -> FloatArray:
    """Return the torque (M, N) in N·m of the rigid arm, payload included, without noise."""
    tau = _torque(arm, motion, options.static)
    if options.payload is None:
        return tau
    loaded = _torque(with_payload(arm, options.payload), motion, options.static)
    if options.payload_at is None:
        return loaded
    return np.where((motion.t >= options.payload_at)[:, None], loaded, tau)


def _torque(arm: Arm, motion: Motion, static: bool) -> FloatArray:
    if static:
        return gravity_torque(arm, motion.q)
    return inverse_dynamics(arm, motion.q, motion.qd, motion.qdd)
