"""Benchmark scenes: an arm with one hidden effect, its poor recording, and the target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from bench.cases.arms import generated_arm
from bench.cases.cases import ARMS as JUDGED
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.hidden import hidden
from gravity_comp_ros.simulation.synthesise import (
    Disturbance, NoiseOptions, synthesise, SynthesisOptions)
import numpy as np

ARMS: dict[str, Callable[[], Arm]] = {
    **JUDGED, **{f'drawn{k}': partial(generated_arm, k, right_angles=True) for k in (0, 1, 4, 5)}}
# Rate in Hz and duration in s of a poor recording.
RATE, SECONDS = 25.0, 60.0
# Largest frequency of the sines, Hz; half ranges of wide and narrow motion, rad.
_BAND, _WIDE, _NARROW = 0.12, 0.7, 0.15
_Path = tuple[FloatArray, FloatArray, FloatArray]
_NOISE = 0.1
# Duration of the additional motion, s.
MORE_SECONDS = 20.0
# Pause between both recordings, s.
_PAUSE = 30.0
# Time stamp of the first recording, s.
_CLOCK = 1.7e9


# Sizes of the hidden effects in the simulation.
SIZES = {'coulomb_friction': 1.0, 'viscous_friction': 8.0, 'torque_offset': 1.5,
         'load_dependent_friction': 0.03, 'joint_spring': 20.0}


@dataclass(frozen=True)
class Scene:
    """
    An arm with an effect hidden on joint number `joint` (from 0), and its poor recording.

    `drawn` is another size of the effect. The axes of a `described` arm are known.
    """

    arm: str
    effect: str
    joint: int
    poor: str
    seed: int
    described: bool = False
    drawn: float | None = None

    @property
    def name(self) -> str:
        kind = '-described' if self.described else ''
        return f'{self.arm}-{self.effect}-{self.joint + 1}-{self.poor}-{self.seed}{kind}'

    @property
    def size(self) -> float:
        """Return the size of the hidden effect."""
        return SIZES[self.effect] if self.drawn is None else self.drawn

    @property
    def arm_model(self) -> Arm:
        return ARMS[self.arm]()

    @property
    def truth(self) -> str:
        """Return the hidden effect as a target."""
        return f'{self.effect}:{self.arm_model.joints[self.joint]}'

    @property
    def disturbance(self) -> Disturbance:
        """Return the hidden effect."""
        return hidden(f'{self.effect}:{self.joint + 1}={self.size}', self.arm_model).disturbance

    def recorded(self) -> JointSamples:
        """Return the poor recording."""
        arm = self.arm_model
        middle = np.random.default_rng(self.seed).uniform(-0.5, 0.5, arm.n_joints)
        path = POOR[self.poor](arm, self.joint, middle, self.seed)
        motion = motions.sample(self.poor, path, SECONDS, RATE)
        return replace(self._samples(motion, 0), starts=(_CLOCK,))

    def later(self, motion: motions.Motion) -> JointSamples:
        """Return the recording of another motion half a minute after the poor recording."""
        return replace(self._samples(motion, 1), starts=(_CLOCK + SECONDS + _PAUSE,))

    def _samples(self, motion: motions.Motion, repetition: int) -> JointSamples:
        options = SynthesisOptions(NoiseOptions(0.0, _NOISE), 100 * self.seed + repetition,
                                   disturbances=(self.disturbance,))
        return synthesise(self.arm_model, motion, options)


def slow_sines(low: FloatArray, high: FloatArray, speed: float, seed: int) -> motions.Motion:
    """Return random sines of all joints between position limits (N,), up to `speed` rad/s."""
    sines = motions.MultisineOptions(speed, MORE_SECONDS, 0.25, 5, 2.0)
    return motions.multisine(low, high, np.full(len(low), speed), seed, sines, MORE_SECONDS, RATE)


def _wander(arm: Arm, middle: FloatArray, reach: float, seed: int) -> motions.Path:
    return motions.multisine(middle - reach, middle + reach, arm.max_speed, seed,
                             motions.MultisineOptions(_BAND, SECONDS), SECONDS, RATE).path


def _of_all(reach: float) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return slow sines of all joints."""
    return lambda arm, joint, middle, seed: _wander(arm, middle, reach, seed)


def _with_own(own: Callable[[FloatArray], _Path]
              ) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return slow sines of all joints except one, which moves by `own` about its middle."""
    def make(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
        others = _wander(arm, middle, _WIDE, seed)

        def path(t: FloatArray) -> _Path:
            q, qd, qdd = (x.copy() for x in others(t))
            for values, column in zip((q, qd, qdd), own(t)):
                values[:, joint] = column
            q[:, joint] += middle[joint]
            return q, qd, qdd
        return path
    return make


def _one_posture(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
    """Return slow sines of one joint, with the others at rest."""
    wander, moving = _wander(arm, middle, _WIDE, seed), np.arange(arm.n_joints) == joint

    def path(t: FloatArray) -> _Path:
        q, qd, qdd = wander(t)
        return np.where(moving, q, middle), moving * qd, moving * qdd
    return path


def _one_way(t: FloatArray) -> _Path:
    """Return 1.2 rad in one direction at varying speed."""
    w, span = 2 * np.pi * 4 / SECONDS, 1.2 / SECONDS
    return (span * (t + 0.7 * np.sin(w * t) / w) - 0.6, span * (1 + 0.7 * np.cos(w * t)),
            -0.7 * span * w * np.sin(w * t))


def _one_speed(t: FloatArray) -> _Path:
    """Return strokes back and forth at 0.1 rad/s, with reversals of 0.4 s."""
    period, speed, reversal = 16.0, 0.1, 0.4

    def velocity(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return direction, share of the speed limit in a reversal, and velocity."""
        x = np.mod(t, period)
        edge = np.minimum(np.minimum(x, np.abs(x - period / 2)), period - x)
        sign = np.where(x < period / 2, 1.0, -1.0)
        share = np.clip(edge / reversal, 0.0, 1.0)
        return sign, share, sign * speed * share * share * (3 - 2 * share)

    sign, share, qd = velocity(t)
    quarter = np.where(np.mod(t, period / 2) < period / 4, 1.0, -1.0)
    slope = np.where(share < 1.0, quarter, 0.0)
    qdd = sign * speed * 6 * share * (1 - share) * slope / reversal
    grid = np.linspace(0.0, SECONDS + 1.0, 20001)
    on_grid = velocity(grid)[2]
    q = np.cumsum(0.5 * (on_grid[1:] + on_grid[:-1]) * np.diff(grid))
    return np.interp(t, grid, np.concatenate([[0.0], q]) - 0.4), qd, qdd


POOR: dict[str, Callable[[Arm, int, FloatArray, int], motions.Path]] = {
    'one_way': _with_own(_one_way), 'narrow': _of_all(_NARROW),
    'one_speed': _with_own(_one_speed), 'one_posture': _one_posture}
