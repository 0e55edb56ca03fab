"""
Sufficiency of the motion of recordings for gravity, and the slow motion that they lack.

The posterior of axes and moments of a rough fit, with offset, friction and inertia of each joint,
gives the standard deviation of gravity at poses within the recorded ranges, in any combination.
Offsets may deviate in later recordings, by a size that has the most evidence (D. MacKay, Bayesian
interpolation, Neural Computation 4, 1992).
The precision of slow motion adds to it (`planning.sums`): sweeps of one joint at several poses of
the others, and tours of all joints, are added until every joint is certain enough. A joint that
hardly moves is uncertain at other angles, so that its range is at least `min_range`.

A rough fit is one of several where joints follow others: its posterior does not contain the rest.
Joints whose angle is a linear function of the other angles are named for themselves.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_search import search
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.noise import correlation_times, floor, WHITE
from gravity_comp_ros.models.sparse.identifiability import at_rest
from gravity_comp_ros.planning.options import PlanOptions
from gravity_comp_ros.planning.segments import duration, Limits, sampled, through
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import arm_problem, generic_poses
from gravity_comp_ros.regression.unknown_lengths import LengthPriors
import numpy as np

# Rows of the fit, and of a planned motion.
_ROWS, _PLANNED = 400, 40
_STARTS, _MIN_SAMPLES = 12, 30
# Rounds in which noise and deviations of offsets are estimated.
_ROUNDS = 5
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
                'sweeps': [asdict(sweep) for sweep in self.sweeps],
                'dependent': list(self.dependent), 'directions': self.directions,
                'moving': self.moving}


def enough_motion(samples: JointSamples, geometry: Geometry | None = None) -> Enough:
    """
    Return the sufficiency of the motion of one or several recordings.

    :param geometry: axes of the samples' joints; None for unknown axes.
    :raises FitError: if there are too few samples, no joint moves, or no effort is measured.
    """
    if samples.n_samples < _MIN_SAMPLES or at_rest(samples.q).all() or not samples.tau.any():
        raise FitError('no motion with efforts, from which gravity could be estimated')
    sums = _Sums(Problem.of(samples), geometry)
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
    Precision of axes and moments (4N), then the generic columns of each joint (4N).

    That of the K deviations of each offset in later recordings (N K) is eliminated.
    """

    def __init__(self, problem: Problem, geometry: Geometry | None) -> None:
        self.scale = problem.scale
        middle = 0.5 * (problem.scale.low + problem.scale.high)
        half = 0.5 * np.maximum(problem.scale.high - problem.scale.low, LIMITS.min_range)
        self.low, self.high = middle - half, middle + half
        poses, nuisance = generic_poses(problem, _ROWS)
        self.q, n = poses.q, poses.n_joints
        if geometry is None:
            self.chain = search(arm_problem(poses, nuisance), _STARTS).chain
        else:
            self.chain = Chain(geometry.rotations, np.zeros((n, 2)))
        moment = LengthPriors().moment * problem.scale.largest
        prior_std = np.full(n * (4 + nuisance.columns.shape[1]), moment)
        prior_std[:2 * n] = LengthPriors().tilt if geometry is None else _EXACT
        x = self._columns(self.q, nuisance.columns)
        beta, residual, weight = self._fitted(x, poses.tau - self.chain.torque(self.q), prior_std,
                                              floor(poses.tau))
        if geometry is not None:
            self.chain = Chain(geometry.rotations, beta[2 * n:4 * n].reshape(n, 2))
        times = correlation_times(residual, poses.runs)
        rows = problem.rows.n_rows / len(self.q)
        self.weight = weight / np.where(times < WHITE, 1.0, times * rows)
        whole = _products(x, rows * self.weight, prior_std)
        own = slice(8 * n, None)
        self.recorded = whole[:8 * n, :8 * n] - whole[:8 * n, own] @ np.linalg.solve(
            whole[own, own], whole[own, :8 * n])
        poses_in_range = random_poses(n, self.low, self.high)
        at = self.chain.jacobian(poses_in_range)
        self.mean_square = np.einsum('inp,jnp->nij', at, at) / len(poses_in_range)

    @staticmethod
    def _fitted(x: FloatArray, tau: FloatArray, prior_std: FloatArray, least: float
                ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """
        Return coefficients, residual (M, N) and weights (N,) of the noise.

        :param prior_std: of all coefficients; those of deviations of offsets are replaced by the
            size of most evidence.
        :param least: smallest noise and deviation, N·m.
        """
        n = tau.shape[1]
        offsets = np.arange(8 * n, x.shape[1]).reshape(n, -1)
        weight = np.full(n, 1.0 / max(float(tau.var()), least ** 2))
        for _ in range(_ROUNDS):
            covariance = _inverse(_products(x, weight, prior_std))
            beta = covariance @ np.einsum('n,njm,mn->j', weight, x, tau)
            residual = tau - np.einsum('njm,j->mn', x, beta)
            weight = 1.0 / ((residual ** 2).mean(axis=0) + least ** 2)
            known = (1.0 - np.diag(covariance) / prior_std ** 2)[offsets].sum(axis=1)
            squares = (beta[offsets] ** 2).sum(axis=1) / np.maximum(known, 1e-9)
            prior_std[offsets] = np.sqrt(squares + least ** 2)[:, None]
        return beta, residual, weight

    def _columns(self, q: FloatArray, nuisance: FloatArray) -> FloatArray:
        """Return the columns (N, 8N + N K, M) of each joint's torque."""
        n, count = q.shape[1], nuisance.shape[1] - 4
        x = np.zeros((n, n * (8 + count), len(q)))
        x[:, :4 * n] = self.chain.jacobian(q).transpose(1, 0, 2)
        for joint, own in enumerate(nuisance):
            x[joint, 4 * (n + joint):4 * (n + joint + 1)] = own[:4]
            x[joint, 8 * n + count * joint:8 * n + count * (joint + 1)] = own[4:]
        return x

    def std(self, precision: FloatArray) -> FloatArray:
        """Return the standard deviation (N,) of gravity as a share of the torque scale."""
        p = self.mean_square.shape[1]
        square = np.einsum('ij,nji->n', _inverse(precision)[:p, :p], self.mean_square)
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
        lines = through([*postures, postures[0]], Limits(
            LIMITS.speed, PlanOptions.max_acceleration, PlanOptions.max_jerk))
        seconds = duration(lines)
        q, qd, qdd = sampled(lines, _PLANNED / seconds)[1]
        nuisance = np.stack([np.ones(q.shape), np.sign(qd), qd, qdd])
        rows = seconds / EngineOptions().row_seconds / len(q)
        x = self._columns(q, nuisance.transpose(2, 0, 1))
        return seconds, _products(x, rows * self.weight)


def _products(x: FloatArray, weight: FloatArray, prior_std: FloatArray | float = np.inf
              ) -> FloatArray:
    """Return the precision (P, P) of columns (N, P, M) and of a prior."""
    prior = np.eye(x.shape[1]) * np.square(1.0 / np.asarray(prior_std))
    return np.asarray(prior + sum(w * (own @ own.T) for w, own in zip(weight, x)))


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
