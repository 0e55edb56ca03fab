"""Losses of joint states between arm and recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import OptionError
import numpy as np


class Degradation(Protocol):
    """A loss in the samples of one run."""

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        """Return the run after the loss."""


@dataclass(frozen=True)
class LostMessages:
    """Lost messages: the share `single` at random, and `bursts` gaps of a second."""

    single: float = 0.1
    bursts: int = 3

    def __post_init__(self) -> None:
        if not 0.0 <= self.single < 1.0 or self.bursts < 0:
            raise OptionError('lost messages: single lies in [0, 1), bursts is at least 0')

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        keep = rng.random(len(run)) >= self.single
        for start in rng.uniform(run.t[0], run.t[-1], self.bursts):
            keep &= (run.t < start) | (run.t > start + 1.0)
        return run.select(keep)


@dataclass(frozen=True)
class FilteredTorque:
    """Torque smoothed by a second-order Butterworth filter with `cutoff` Hz."""

    cutoff: float = 5.0

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        from scipy import signal  # slow to import

        rate = 1.0 / float(np.median(np.diff(run.t)))
        sections = signal.butter(2, self.cutoff, fs=rate, output='sos')
        begin = signal.sosfilt_zi(sections)[:, :, None] * run.tau[0]
        return replace(run, tau=signal.sosfilt(sections, run.tau, axis=0, zi=begin)[0])


@dataclass(frozen=True)
class SteppedTorque:
    """Torque quantised to `step` N·m."""

    step: float = 0.1

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        return replace(run, tau=np.round(run.tau / self.step) * self.step)


@dataclass(frozen=True)
class NoVelocity:
    """Missing velocities, differentiated from the positions."""

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        qd = differentiate(run.t, run.q)
        known = np.isfinite(qd).all(axis=1)
        return replace(run.select(known), qd=qd[known])
