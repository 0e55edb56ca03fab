"""From arm, motion, payload and noise to the samples that a recording would hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import (
    Arm, gravity_torque, inverse_dynamics, Payload, with_payload)
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.noise import add_noise, NoiseOptions
import numpy as np


@dataclass(frozen=True, eq=False)
class Signals:
    """What the arm's sensors would say: `q`, `qd`, `tau` (M, N) in rad, rad/s and N·m."""

    q: FloatArray
    qd: FloatArray
    tau: FloatArray


class Disturbance(Protocol):
    """Something that a rigid arm does not have; it changes what the sensors say."""

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        """
        Return the signals with this disturbance in them.

        :param signals: as the disturbances before this one left them, without noise.
        :param motion: the true motion; its path serves integration in finer steps.
        """


@dataclass(frozen=True)
class SynthesisOptions:
    """
    How the torque of a motion comes about.

    `static` leaves speed and acceleration out of the torque (and reports a speed of 0), as
    though the arm had stopped for every sample. A `payload` is there from the beginning, or
    from time `payload_at` in s on the motion's own clock. `disturbances` act in their order,
    then `noise` is added. `seed` fixes noise and disturbances.
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

    :raises OptionError: if the motion has not as many joints as the arm.
    """
    if motion.n_joints != arm.n_joints:
        raise OptionError(
            f'motion {motion.name} is for {motion.n_joints} joints and {arm.name} has '
            f'{arm.n_joints}; random poses and multisines fit every arm')
    qd = np.zeros_like(motion.qd) if options.static else motion.qd
    signals = Signals(motion.q, qd, rigid_torque(arm, motion, options))
    # Own streams, so that adding a disturbance leaves the noise as it was.
    noise_stream, *streams = np.random.SeedSequence(options.seed).spawn(
        1 + len(options.disturbances))
    for disturbance, stream in zip(options.disturbances, streams):
        signals = disturbance.apply(signals, motion, arm, np.random.default_rng(stream))
    tau = add_noise(motion.t, signals.tau, options.noise, np.random.default_rng(noise_stream))
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
