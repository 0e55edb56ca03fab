"""
Sparse update of a chain after a payload change: fixed axes, few changed moments.

A payload of mass m adds m times the distance to the next joint to the moment of every link, and
its own first moment to that of the last link. The kinematics, which are unknown, decide which of
a link's two moments changes; on an arm with right angles it is one of the two or neither, so the
change is sparse. The axes move only within their uncertainty.

An axis without an identified direction (that of a last link without a moment of its own) becomes
identifiable with a payload on it. Its candidates are each axis of the frame before it, and any
direction; the evidence selects one.

The direction of an outer axis whose links have a small moment may be wrong, although its standard
deviation is small: the fit was at one of several minima. The outermost axes are therefore also
tried without what was known of them, at a price.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.models.kinematic.chain import aligned, Chain
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.noise import is_outlier
from gravity_comp_ros.models.sparse.sparse_change import (
    average_change, Change, ChangeProblem, find_change, full_evidence)
from gravity_comp_ros.regression.unknown_lengths import LengthPriors
import numpy as np
from scipy.special import softmax

_DIRECTIONS = ((0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
# Minimum regressor norm, as a share of the largest, of a moment that may change.
_MIN_RELATIVE_NORM = 1e-3


@dataclass(frozen=True)
class NewSamples:
    """
    Poses `q` (M, N) in rad, torques `tau` (M, N) and their noise `sigma` (N,) in N·m.

    `robust_weights` (M, N) are weights of squared residuals, below 1 for outliers. `offset_std`,
    (N,) or 0 in N·m, is the standard deviation of an offset of these samples.
    """

    q: FloatArray
    tau: FloatArray
    sigma: FloatArray
    robust_weights: FloatArray
    offset_std: FloatArray | float = 0.0

    @property
    def row_weights(self) -> FloatArray:
        """Return one over the standard deviation of each torque, (M, N) in 1/(N·m)."""
        return np.asarray(np.sqrt(self.robust_weights) / self.sigma)

    def in_noise(self, torque: FloatArray) -> FloatArray:
        """
        Return torques (..., N, M) in units of the noise, of which the offset is a part.

        Its share of each row makes the rows independent, so that squares are those of noise.
        """
        weight = self.row_weights.T
        size = np.linalg.norm(weight, axis=-1, keepdims=True)
        along = weight / np.maximum(size, 1e-300)
        std = np.broadcast_to(self.offset_std, self.sigma.shape)[:, None]
        share = 1.0 - 1.0 / np.sqrt(1.0 + (std * size) ** 2)
        rows = torque * weight
        return np.asarray(rows - share * (rows * along).sum(axis=-1, keepdims=True) * along)

    def residual(self, chain: Chain) -> FloatArray:
        """Return the residual of a chain in units of the noise, shape (N M,)."""
        return self.in_noise((self.tau - chain.torque(self.q)).T).ravel()

    def max_residual(self, chain: Chain) -> float:
        """Return the largest residual of a chain among samples with weight, in N·m."""
        residual = (self.tau - chain.torque(self.q))[~is_outlier(self.robust_weights)]
        return float(np.abs(residual).max(initial=0.0))

    def columns(self, chain: Chain) -> FloatArray:
        """Return d torque / d step, in units of the noise, shape (4N, N M)."""
        jacobian = self.in_noise(chain.jacobian(self.q))
        return jacobian.reshape(len(jacobian), -1)


@dataclass(frozen=True)
class ChainChange:
    """
    The chain with its new moments, the covariance of a step from it, and the sparse change.

    `trials` are those with enough evidence.
    """

    chain: Chain
    covariance: FloatArray
    change: Change
    trials: tuple[Trial, ...] = ()


@dataclass(frozen=True, eq=False)
class Trial:
    """A chain before the change, the covariance (4N, 4N) of a step from it, and its price."""

    chain: Chain
    prior: FloatArray
    price: float = 0.0


def update_chain(chain: Chain, covariance: FloatArray, new: NewSamples, box: FloatArray,
                 trials: tuple[Trial, ...] = (),
                 path: FloatArray | None = None) -> ChainChange:
    """
    Update a chain by a sparse change of its moments.

    :param covariance: of a step from the chain (4N, 4N).
    :param box: lower and upper ends (2, N) in rad of the poses of later predictions.
    :param trials: those of an earlier change to the same samples; without any they are searched.
    :param path: change of the moments (2N,) by an earlier payload (`payload_path`). Another
        payload changes them in proportion to its mass, except those that depend on its centre.
    """
    if not trials:
        trials = (*_most_probable(_trials(chain, covariance), new, OPTIONS.trials),
                  *_most_probable(_reset_trials(chain, covariance), new, OPTIONS.resets))
    along = None
    if path is not None and np.abs(path).max() > 0.0:
        along = np.concatenate([np.zeros(2 * chain.n_joints), path / np.abs(path).max()])[None]
    hypotheses = _probable([_Hypothesis(trial, new, along) for trial in trials])
    q = random_poses(chain.n_joints, *box)
    torques = np.array([each.moved.torque(q) for each in hypotheses])
    probabilities = softmax([each.log_evidence for each in hypotheses])
    probable = int(np.argmax(probabilities))
    best = hypotheses[probable].averaged()
    # The covariance of the average over supports has that hypothesis already.
    torques[probable] = best.chain.torque(q)
    return replace(best, trials=tuple(each.trial for each in hypotheses),
                   covariance=best.covariance + _spread(best.chain, q, torques, probabilities))


def _most_probable(trials: list[Trial], new: NewSamples, count: int) -> list[Trial]:
    """Return at most `count` trials, by the evidence of a change of all moments, linearised."""
    if len(trials) <= count:
        return trials
    evidence = [_initial_evidence(trial, new) for trial in trials]
    return [trials[k] for k in np.argsort(-np.array(evidence))[:count]]


def _initial_evidence(trial: Trial, new: NewSamples) -> float:
    """Return the log evidence of a change of all moments, linearised at the chain of a trial."""
    n = trial.chain.n_joints
    return full_evidence(ChangeProblem(
        new.columns(trial.chain), new.residual(trial.chain), trial.prior,
        np.arange(2 * n, 4 * n), new.max_residual(trial.chain)))


def _probable(hypotheses: list[_Hypothesis]) -> list[_Hypothesis]:
    """Return the hypotheses whose evidence is a minimum share of the largest."""
    best = max(each.log_evidence for each in hypotheses)
    return [each for each in hypotheses
            if each.log_evidence > best + np.log(OPTIONS.probable)]


def _spread(chain: Chain, q: FloatArray, torques: FloatArray,
            probabilities: FloatArray) -> FloatArray:
    """
    Return the covariance (4N, 4N) of a step from the chain to the hypotheses.

    A hypothesis is represented by the step whose torque at poses q is closest to it, in least
    squares.

    :param torques: of the H hypotheses at the poses, (H, M, N), and their probabilities (H,).
    """
    jacobian = chain.jacobian(q)
    differences = (torques - chain.torque(q)).transpose(2, 1, 0).reshape(-1, len(torques))
    steps = lstsq(jacobian.reshape(len(jacobian), -1).T, differences, rcond=_MIN_RELATIVE_NORM)
    return np.asarray((steps * probabilities) @ steps.T)


def _trials(chain: Chain, covariance: FloatArray) -> list[Trial]:
    """Return the chain as it is, and with its unidentified axes along every frame axis."""
    n = chain.n_joints
    axes, moments = _std(covariance)
    is_unidentified = ((axes.min(axis=1) > OPTIONS.unidentified)
                       & (np.abs(chain.moments) <= OPTIONS.significant * moments).all(axis=1))
    unidentified = [j for j in range(1, n) if is_unidentified[j]][-OPTIONS.axes:]
    return [Trial(chain, covariance), *_along_frame_axes(chain, covariance, unidentified)]


def _reset_trials(chain: Chain, covariance: FloatArray) -> list[Trial]:
    """
    Return the chain with its uncertain outer axes along every frame axis, their moments reset.

    A joint's direction and moments are relative to the frame before it, so all joints beyond the
    first reset one are reset too.
    """
    n = chain.n_joints
    std = _std(covariance)[0].max(axis=1)
    uncertain = [j for j in range(max(n - OPTIONS.axes, 1), n)
                 if std[j] > OPTIONS.uncertain]
    reset = list(range(uncertain[0], n)) if uncertain else []
    moment_std = float(np.abs(chain.moments[reset]).max(initial=0.0))
    if moment_std == 0.0:
        # Without moments they are the unidentified axes of `_trials`.
        return []
    moments, prior = chain.moments.copy(), covariance.copy()
    moments[reset] = 0.0
    numbers = [2 * n + 2 * j + k for j in reset for k in range(2)]
    prior[numbers], prior[:, numbers] = 0.0, 0.0
    prior[numbers, numbers] = moment_std ** 2
    return _along_frame_axes(Chain(chain.axes, moments), prior, reset, OPTIONS.reset)


def _std(covariance: FloatArray) -> FloatArray:
    """Return the standard deviations (2, N, 2) of axes, in rad, and of moments, in N·m."""
    return np.asarray(np.sqrt(np.diag(covariance)).reshape(2, -1, 2))


def _along_frame_axes(chain: Chain, covariance: FloatArray, joints: list[int],
                      price: float = 0.0) -> list[Trial]:
    """Return trials with the axes of `joints` along each frame axis, exactly and nearly."""
    trials = []
    for directions in product(_DIRECTIONS, repeat=len(joints)) if joints else []:
        axes, prior = chain.axes.copy(), covariance.copy()
        for j, direction in zip(joints, directions):
            axes[j] = aligned(np.array(direction, dtype=np.float64))
            rows = slice(2 * j, 2 * j + 2)
            prior[rows], prior[:, rows] = 0.0, 0.0
        right_angled = prior.copy()
        for j in joints:
            diagonal = [2 * j, 2 * j + 1]
            prior[diagonal, diagonal] = 1.0
            right_angled[diagonal, diagonal] = LengthPriors.right ** 2
        start = Chain(axes, chain.moments)
        trials += [Trial(start, right_angled, price), Trial(start, prior, price)]
    return trials


class _Hypothesis:
    """A trial with its most probable sparse change, linearised at the changed chain."""

    def __init__(self, trial: Trial, new: NewSamples, along: FloatArray | None = None) -> None:
        chain = trial.chain
        self.trial, self.new, self.along = trial, new, along
        self.step = np.zeros(4 * chain.n_joints)
        self.moved, self.residual = chain, new.residual(chain)
        # A moment acts with its full size in some pose: its prior std is the change of torques.
        self.size = new.max_residual(chain)
        change = None
        for _ in range(OPTIONS.rounds):
            problem = self._problem()
            change = find_change(problem, change)
            if self._move(change.mean, problem):
                break
        assert change is not None
        # After the last round the linearised misfit may differ from the true misfit of the
        # chain; the log evidence is corrected to the true one.
        self.change = change
        linear = problem.residual - change.mean @ problem.columns
        true = new.residual(chain.moved(change.mean))
        misfit = 0.5 * float(true @ true - linear @ linear)
        self.log_evidence = change.log_evidence - misfit - trial.price

    def averaged(self) -> ChainChange:
        """
        Return the chain of the average over supports.

        The linearisation does not hold for an average far from the most probable support. Where
        the average fits worse, the most probable chain is returned with its covariance.
        """
        problem = self._problem()
        most_probable, residual = self.moved, self.residual
        change = average_change(problem, self.change)
        self._move(change.mean, problem)
        moved = self.moved
        if float(self.residual @ self.residual) > float(residual @ residual) + OPTIONS.max_loss:
            moved = most_probable
        return ChainChange(moved, change.covariance, change)

    def _problem(self) -> ChangeProblem:
        columns = self.new.columns(self.moved)
        n = self.moved.n_joints
        norms = np.linalg.norm(columns[2 * n:], axis=1)
        may_change = np.flatnonzero(norms > _MIN_RELATIVE_NORM * norms.max())
        return ChangeProblem(columns, self.residual + self.step @ columns, self.trial.prior,
                             2 * n + may_change, self.size, self.along)

    def _move(self, target: FloatArray, problem: ChangeProblem) -> bool:
        """
        Move to a step, or towards it; return whether the search converged.

        An axis moves by a limited angle, and half as far while the residual is larger than before
        and than what the average over supports may lose.
        """
        n = self.moved.n_joints
        start, move = self.step, target - self.step
        limit = float(self.residual @ self.residual) + OPTIONS.max_loss
        share = min(1.0, OPTIONS.max_rotation / max(float(np.abs(move[:2 * n]).max()), 1e-300))
        for halvings in range(OPTIONS.rounds):
            self.step = start + 0.5 ** halvings * share * move
            self.moved = self.trial.chain.moved(self.step)
            self.residual = self.new.residual(self.moved)
            if float(self.residual @ self.residual) <= limit:
                break
        return share == 1.0 and halvings == 0 and bool(
            np.abs(move @ problem.columns).max() < OPTIONS.converged)
