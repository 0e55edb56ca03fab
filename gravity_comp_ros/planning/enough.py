"""
Sufficiency of the motion of recordings for gravity, and the slow motion that they lack.

The posterior of axes and moments of a rough fit (`ArmFit`), with offset, friction and inertia of
each joint and recording, gives the standard deviation of gravity at poses within the recorded
ranges, in any combination. The precision of slow motion adds to it: sweeps of one joint at several
poses of the others, and tours of all joints, are added until every joint is certain enough. A
joint that hardly moves is uncertain at other angles, so that its range is at least `min_range`.

A rough fit is one of several where joints follow others: its posterior does not contain the rest.
Joints whose angle is a linear function of the other angles are named for themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.estimation.arm_fit import ArmFit
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem, ArmState, Nuisance
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.noise import WHITE
from gravity_comp_ros.models.sparse.dictionary import at_rest
from gravity_comp_ros.planning.workspace import duration, PlanOptions, sampled, through
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.start import CHANGING, GENERIC
from gravity_comp_ros.regression.unknown_lengths import LengthPriors
import numpy as np

# Rows of a planned motion; smallest number of samples.
_PLANNED, _MIN_SAMPLES = 40, 30
# Prior standard deviation of offset, friction and inertia, per N·m of noise: they are free.
_FREE = 1e6
# Poses of the other joints at which a joint is swept; tours of all joints, and their postures.
_BASES, _TOURS, _POSTURES = 3, 6, 6
# Angle in rad of an axis that a description gives.
_EXACT = 1e-6


@dataclass(frozen=True)
class EnoughOptions:
    """
    Limits of sufficient motion.

    - `max_std`: standard deviation of gravity as a share of a joint's torque; twice this share is
      the 95 % band, and a payload of a tenth of the arm changes the torque by as much.
    - `min_range`, rad: range of a joint for which a model is useful; the sine of half of it on
      either side differs from a line.
    - `min_scale`: smallest torque scale of a joint as a share of the largest; a vertical joint has
      the torque of friction alone.
    - `speed`, rad/s: of the motion to add; below the limit of the slow-motion gate.
    - `max_seconds`: longest motion that is proposed, s.
    - `min_share`: share of the standard deviation of a joint's angle that the angles of the other
      joints must leave.

    :raises OptionError: if a value is not positive.
    """

    max_std: float = 0.05
    min_range: float = 1.0
    min_scale: float = 0.2
    speed: float = 0.1
    max_seconds: float = 600.0
    min_share: float = 0.05

    def __post_init__(self) -> None:
        check_positive(self, 'motion')


LIMITS = EnoughOptions()


@dataclass(frozen=True)
class Stroke:
    """Slow motion of a joint from `low` to `high` and back, in rad, for `seconds`."""

    joint: str
    low: float
    high: float
    seconds: float

    def __str__(self) -> str:
        return f'{self.joint} from {self.low:.2f} to {self.high:.2f} rad for {self.seconds:.0f} s'


@dataclass(frozen=True)
class Enough:
    """
    Sufficiency of motion.

    `std` by joint is the standard deviation of gravity as a share of the joint's torque scale,
    `after` that with the motion to add: `sweeps` of single joints, and `together` s of all joints
    at once between poses of their ranges. `dependent` are joints that follow the others; the
    angles span `directions` dimensions of `moving` joints.
    """

    std: dict[str, float]
    after: dict[str, float]
    sweeps: tuple[Stroke, ...]
    together: float
    dependent: tuple[str, ...]
    directions: int
    moving: int

    @property
    def seconds(self) -> float:
        """Return the duration of the motion to add, s."""
        return self.together + sum(sweep.seconds for sweep in self.sweeps)

    def facts(self) -> list[Fact]:
        """Return the facts on motion that is missing."""
        facts = []
        if self.dependent:
            facts.append(Fact(
                Kind.MOTION, self.dependent,
                f'{", ".join(self.dependent)} follow the other joints: the poses of {self.moving} '
                f'moving joints span {self.directions} directions', Action.NOTED,
                'a model may be wrong at other poses; move these joints on their own as well, or '
                'all joints with different periods'))
        uncertain = {name: share for name, share in self.std.items() if share > LIMITS.max_std}
        if uncertain:
            largest = sorted(uncertain, key=lambda name: -uncertain[name])
            words = ', '.join(f'{size} on {", ".join(names)}' for size, names in groupby(
                largest, lambda name: _percent(uncertain[name])))
            facts.append(Fact(
                Kind.MOTION, tuple(uncertain), f'too little motion for a model: the standard '
                f'deviation of gravity within the ranges, as a share of the torque, is {words}',
                Action.NOTED, self._advice, values=uncertain))
        return facts

    @property
    def _advice(self) -> str:
        parts = [str(sweep) for sweep in self.sweeps]
        if self.together:
            parts.append(f'all joints at once, each over its range and at least '
                         f'{LIMITS.min_range:g} rad, for {self.together:.0f} s')
        motion = (f'record {self.seconds:.0f} s more at about {LIMITS.speed:g} rad/s: '
                  f'{"; ".join(parts)}')
        worst = max(self.after.values())
        if worst <= LIMITS.max_std:
            return motion
        if self.seconds == 0:
            return 'slow motion within these ranges does not reduce it'
        return f'{motion}; {_percent(worst)} remain'

    def to_json(self) -> dict[str, Any]:
        """Return the entry `motion` of `info --json`."""
        return {'std': self.std, 'std_after': self.after, 'max_std': LIMITS.max_std,
                'seconds': self.seconds, 'together_s': self.together,
                'sweeps': self.sweeps,
                'dependent': self.dependent, 'directions': self.directions,
                'moving': self.moving}


def enough_motion(samples: JointSamples, geometry: Geometry | None = None) -> Enough:
    """
    Return the sufficiency of the motion of one or several recordings.

    :param geometry: axes of the samples' joints; None for unknown axes.
    :raises FitError: if there are too few samples, no joint moves, or no effort is measured.
    """
    if samples.n_samples < _MIN_SAMPLES or at_rest(samples.q).all() or not samples.tau.any():
        raise FitError('no motion with efforts, from which gravity could be estimated')
    sums = _Sums(samples, geometry)
    (*each, together), after = sums.motion_to_add()
    names = samples.names
    sweeps = tuple(Stroke(*stroke) for stroke in zip(
        names, sums.low.tolist(), sums.high.tolist(), each) if stroke[-1])
    dependent, directions, moving = _dependence(samples.q)
    std, after_by_name = (dict(zip(names, x.tolist())) for x in (sums.std(sums.recorded), after))
    return Enough(std, after_by_name, sweeps, together, tuple(names[n] for n in dependent),
                  directions, moving)


class _Sums:
    """
    Precision of axes and moments (4N) by recorded and by planned motion.

    Offset, friction and inertia are eliminated from each: they differ in the next recording.
    """

    def __init__(self, samples: JointSamples, geometry: Geometry | None) -> None:
        fit = ArmFit(samples, None if geometry is None else geometry.rotations)
        state, rows = fit.plain, fit.regression.rows
        self.q, self.chain, self.scale = fit.q, state.chain, fit.regression.scale
        middle = 0.5 * (self.scale.low + self.scale.high)
        half = 0.5 * np.maximum(self.scale.high - self.scale.low, LIMITS.min_range)
        self.low, self.high = middle - half, middle + half
        times = state.times(fit.poses.runs)
        each = rows.n_rows / len(self.q)
        self.weight = 1.0 / (state.noise ** 2 * np.where(times < WHITE, 1.0, times * each))
        n, priors = samples.n_joints, LengthPriors()
        std = np.full(4 * n, priors.moment * self.scale.largest)
        std[:2 * n] = priors.tilt if geometry is None else _EXACT
        nuisance = fit.problem.nuisance.columns * _sizes(fit.problem, state)[:, :, None]
        self.recorded = np.diag(std ** -2.0) + self._precision(self.q, nuisance, each)
        poses_in_range = random_poses(n, self.low, self.high)
        at = self.chain.jacobian(poses_in_range)
        self.mean_square = np.einsum('inp,jnp->nij', at, at) / len(poses_in_range)

    def _precision(self, q: FloatArray, nuisance: FloatArray, rows: float) -> FloatArray:
        """
        Return the precision (4N, 4N) of poses (M, N).

        :param nuisance: columns (N, C, M) of each joint, times the prior standard deviation of
            their coefficients per N·m of noise.
        :param rows: number of rows of the regression for each pose.
        """
        scaled = Nuisance(nuisance, np.ones(nuisance.shape[1]))
        columns = scaled.whitened(self.chain.jacobian(q)) * np.sqrt(rows * self.weight)[:, None]
        flat = columns.reshape(len(columns), -1)
        return np.asarray(flat @ flat.T)

    def std(self, precision: FloatArray) -> FloatArray:
        """Return the standard deviation (N,) of gravity as a share of the torque scale."""
        square = np.einsum('ij,nji->n', _inverse(precision), self.mean_square)
        scale = np.maximum(self.scale.torque, LIMITS.min_scale * self.scale.largest)
        return np.asarray(np.sqrt(np.maximum(square, 0.0)) / scale)

    def motion_to_add(self) -> tuple[list[float], FloatArray]:
        """Return seconds of motions of each joint, then of all, to add, and the result (N,)."""
        limit, total, std = LIMITS.max_std, self.recorded, self.std(self.recorded)
        time = [0.0] * (1 + len(std))
        candidates = self._candidates() if (std > limit).any() else []
        while (std > limit).any() and sum(time) < LIMITS.max_seconds:
            results = [self.std(total + added) for _, _, added in candidates]
            # By how much uncertain joints become certain, in units of ln std per s.
            gains = [float(np.log(np.maximum(std, limit) / np.maximum(after, limit)).sum())
                     / seconds for after, (_, seconds, _) in zip(results, candidates)]
            best = int(np.argmax(gains))
            if gains[best] * LIMITS.max_seconds < limit:
                break
            joint, seconds, added = candidates[best]
            total, std = total + added, results[best]
            time[joint] += seconds
        return time, std

    def _candidates(self) -> list[tuple[int, float, FloatArray]]:
        """Return joint (N for all), duration in s and sums of each motion."""
        rng, n = np.random.default_rng(1), self.q.shape[1]
        bases, result = self.q[rng.integers(0, len(self.q), _BASES)], []
        for joint in range(n):
            for base in bases:
                ends = np.stack([base, base])
                ends[:, joint] = self.low[joint], self.high[joint]
                result.append((joint, *self._moved(ends)))
        return result + [(n, *self._moved(rng.uniform(self.low, self.high, (_POSTURES, n))))
                         for _ in range(_TOURS)]

    def _moved(self, postures: FloatArray) -> tuple[float, FloatArray]:
        """Return duration and sums of the motion through postures (K, N) and back to the first."""
        lines = through([*postures, postures[0]], PlanOptions(max_speed=LIMITS.speed))
        seconds = duration(lines)
        q, qd, qdd = sampled(lines, _PLANNED / seconds)[1]
        nuisance = _FREE * np.stack([np.ones(q.shape), np.sign(qd), qd, qdd]).transpose(2, 0, 1)
        return seconds, self._precision(q, nuisance,
                                        seconds / EngineOptions().row_seconds / len(q))


def _sizes(problem: ArmProblem, state: ArmState) -> FloatArray:
    """
    Return the prior standard deviations (N, C) of the nuisance, per N·m of noise.

    Offset, friction and inertia are free. The deviations between recordings, of each kind, have
    the size that they have in the fit.
    """
    columns, spread = problem.nuisance.columns, problem.nuisance.spread
    sizes = np.full(columns.shape[:2], _FREE)
    residual = problem.tau - state.chain.torque(problem.q)
    for own, size, tau, noise in zip(columns, sizes, residual.T, state.noise):
        mean = np.linalg.solve(own @ own.T + np.diag(spread ** -2.0), own @ tau) / noise
        later = mean[GENERIC:].reshape(-1, len(CHANGING))
        square = (later ** 2).sum(axis=0) / max(len(later), 1)
        size[GENERIC:] = np.tile(np.sqrt(square), len(later))
    return sizes


def _inverse(precision: FloatArray) -> FloatArray:
    size = np.diag(precision) ** -0.5
    scale = np.outer(size, size)
    return np.asarray(np.linalg.inv(precision * scale) * scale)


def _dependence(q: FloatArray) -> tuple[list[int], int, int]:
    """Return joints that follow the others, dimensions of the angles, number of moving joints."""
    moving = np.flatnonzero(np.ptp(q, axis=0) > FactOptions().wide_travel)
    centred = q[:, moving] - q[:, moving].mean(axis=0)
    unit = centred / np.maximum(centred.std(axis=0), 1e-12) / np.sqrt(len(q))
    values, vectors = np.linalg.eigh(unit.T @ unit)
    small = values < LIMITS.min_share ** 2
    # Joints that take part in a combination of angles that hardly varies.
    weight = (vectors[:, small] ** 2).sum(axis=1)
    dependent = [int(moving[k]) for k in np.flatnonzero(weight > LIMITS.min_share)]
    return dependent, int((~small).sum()), len(moving)


def _percent(share: float) -> str:
    return f'{100 * share:.0f} %' if share < 1.0 else 'above 100 %'
