"""
Cross-validated least squares with effects, one joint at a time, on rows sorted by fold.

The torque of joint n is modelled as

    tau_n = S_n s + L_n l_n,

s are the coefficients shared by all joints (gravity and effects of the whole arm), l_n those of
the joint's own effects. The products of all columns are summed once for every training set, so
that a fit is the solution of small normal equations. The information of the other joints about s,
their Schur complements, enters the fit of joint n as a prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.evaluation.blocks import Blocks
import numpy as np
from scipy import linalg

# Ridge relative to the mean diagonal; it affects directions that the data do not determine.
_RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class JointRows:
    """
    One joint's columns and torque, in units of its noise, sorted by fold.

    `x` (M, P) and `y` (M,) are divided by `sigma` N·m, columns also by `scale` (P,): a
    coefficient is its scaled one over `scale`. `row_of` (M,) is the sample of each row. `grams`
    (F + 1, C, C) and `right_sides` (F + 1, P) are the sums of products without each fold, and
    over all folds. `grams` has the first C columns; products of the others are computed on
    demand. `ridge` (P,) is added to the diagonal, for columns with a prior of their own.
    """

    x: FloatArray
    y: FloatArray
    blocks: Blocks
    row_of: IntArray
    grams: FloatArray
    right_sides: FloatArray
    scale: FloatArray
    sigma: float
    ridge: FloatArray

    def gram(self, columns: IntArray) -> FloatArray:
        """Return the products of columns, their ridge included: (F + 1, K, K)."""
        return np.asarray(self.products(columns, columns) + np.diag(self.ridge[columns]))

    def assembled(self, columns: IntArray, n_shared: int,
                  prior: Prior) -> tuple[FloatArray, FloatArray]:
        """
        Return the normal equations (F + 1, K, K) and (F + 1, K) of every training set.

        The first `n_shared` columns have a prior.
        """
        g, r = self.gram(columns), self.right_sides[:, columns]
        g[:, :n_shared, :n_shared] += prior.information
        r[:, :n_shared] += prior.vector
        return g, r

    def combined(self, rows: slice, columns: IntArray, weights: FloatArray) -> FloatArray:
        """Return columns times weights (K, ...) in some rows."""
        # A view of the leading columns, those of gravity, avoids a copy.
        base = int(np.argmin(np.append(columns == np.arange(len(columns)), False)))
        total = self.x[rows, :base] @ weights[:base]
        if base < len(columns):
            total += self.x[rows][:, columns[base:]] @ weights[base:]
        return np.asarray(total)

    def products(self, a: IntArray, b: IntArray) -> FloatArray:
        """Return the sums of products of columns a with b: (F + 1, A, B)."""
        core = self.grams.shape[1]
        if max(a.max(initial=0), b.max(initial=0)) < core:
            return self.grams[:, a[:, None], b]
        left, right = self.x[:, a], self.x[:, b]
        return leave_one_out_sums(np.stack([left[rows].T @ right[rows] for rows in self.folds]))

    def own_products(self, columns: IntArray) -> FloatArray:
        """Return products of each of E sets of columns (E, K) with itself, (F + 1, E, K, K)."""
        if columns.max(initial=0) < self.grams.shape[1]:
            grams = self.grams[:, columns[:, :, None], columns[:, None]]
        else:
            grams = np.stack([self.products(one, one) for one in columns], axis=1)
        return grams + self.ridge[columns][:, None] * np.eye(columns.shape[1])

    @property
    def folds(self) -> tuple[slice, ...]:
        """Return the rows of each fold."""
        return self.blocks.by_fold[1]

    @cached_property
    def _order(self) -> tuple[IntArray, IntArray]:
        """Return the blocks in the order of their rows, and the first row of each."""
        order = np.argsort(self.blocks.fold, kind='stable')
        lengths = np.diff(self.blocks.starts)[order]
        return order, np.concatenate([[0], np.cumsum(lengths)[:-1]])

    def block_sums(self, values: FloatArray) -> FloatArray:
        """Return sums over each block (B, ...) of values (M, ...) of rows."""
        order, starts = self._order
        sums = np.empty((self.blocks.count, *values.shape[1:]))
        sums[order] = np.add.reduceat(values, starts, axis=0)
        return sums

    def group_of_rows(self, groups: IntArray) -> IntArray:
        """Return the group of each row (M,), from that of each block (B,)."""
        return np.repeat(groups, np.diff(self.blocks.starts))[self.row_of]


def joint_rows(x: FloatArray, y: FloatArray, blocks: Blocks, scale: FloatArray, sigma: float,
               prior_samples: FloatArray, n_core: int | None = None) -> JointRows:
    """
    Return one joint's columns x (M, P) and torque y (M,) with their products.

    :param scale: (P,) divisors of the columns; the same in all joints for shared columns, so that
        scaled coefficients are comparable.
    :param prior_samples: (P,) weight of a zero-mean prior with standard deviation `sigma`, as an
        equivalent number of samples with the column at 1; 0 for no prior.
    :param n_core: number of leading columns whose products are stored; None for all.
    """
    return sorted_joint_rows(join_columns([x], blocks.by_fold[0]), y, blocks, scale, sigma,
                             prior_samples, n_core)


def sorted_joint_rows(rows: FloatArray, y: FloatArray, blocks: Blocks, scale: FloatArray,
                      sigma: float, prior_samples: FloatArray, n_core: int | None = None
                      ) -> JointRows:
    """Return the same from columns whose rows are sorted by fold; they are divided in place."""
    row_of, folds = blocks.by_fold
    torque = y[row_of] / sigma
    rows /= scale * sigma
    core = rows[:, :n_core]
    return JointRows(rows, torque, blocks, row_of,
                     leave_one_out_sums(np.stack([core[f].T @ core[f] for f in folds])),
                     leave_one_out_sums(np.stack([rows[f].T @ torque[f] for f in folds])),
                     scale, sigma, prior_samples / (scale * sigma) ** 2)


def join_columns(parts: Sequence[FloatArray], row_of: IntArray) -> FloatArray:
    """Return some rows of the columns of parts (M, K) in one column-major array."""
    # Column-major order: columns are selected far more often than rows.
    whole = np.empty((len(row_of), sum(part.shape[1] for part in parts)), order='F')
    at = 0
    for part in parts:
        whole[:, at:at + part.shape[1]] = part[row_of]
        at += part.shape[1]
    return whole


def with_gravity_columns(joint: JointRows, base: FloatArray, n_before: int) -> JointRows:
    """
    Return the same joint with other columns of gravity, base (M, K) in the order of samples.

    :param n_before: number of its present columns of gravity.
    """
    k, shift = base.shape[1], base.shape[1] - n_before
    scale = np.concatenate([np.ones(k), joint.scale[n_before:]])
    ridge = np.concatenate([np.zeros(k), joint.ridge[n_before:]])
    x = np.empty((len(joint.x), joint.x.shape[1] + shift), order='F')
    x[:, :k], x[:, k:] = base[joint.row_of] / joint.sigma, joint.x[:, n_before:]
    core = joint.grams.shape[1] + shift
    grams = np.empty((len(joint.grams), core, core))
    grams[:, k:, k:] = joint.grams[:, n_before:, n_before:]
    strip = leave_one_out_sums(np.stack([x[f, :k].T @ x[f, :core] for f in joint.folds]))
    grams[:, :k], grams[:, :, :k] = strip, strip.transpose(0, 2, 1)
    of_base = leave_one_out_sums(np.stack([x[f, :k].T @ joint.y[f] for f in joint.folds]))
    right_sides = np.concatenate([of_base, joint.right_sides[:, n_before:]], axis=1)
    return JointRows(x, joint.y, joint.blocks, joint.row_of, grams, right_sides, scale,
                     joint.sigma, ridge)


def leave_one_out_sums(sums: FloatArray) -> FloatArray:
    """Return the sum over folds (F, ...) without each of them, and over all: (F + 1, ...)."""
    total = sums.sum(axis=0)
    return np.concatenate([total - sums, total[None]])


@dataclass(frozen=True, eq=False)
class Prior:
    """
    Information of other joints about shared columns: (F + 1, S, S) and the vector (F + 1, S).

    One for each of the F folds left out, and the last one with all data.
    """

    information: FloatArray
    vector: FloatArray

    @classmethod
    def none(cls, n_folds: int, size: int) -> Prior:
        """Return the prior without other joints."""
        return cls(np.zeros((n_folds + 1, size, size)), np.zeros((n_folds + 1, size)))

    def __add__(self, other: Prior) -> Prior:
        return Prior(self.information + other.information, self.vector + other.vector)


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients (P,) in scaled columns: all data, and with each fold left out (F, P)."""

    columns: IntArray
    all_data: FloatArray
    by_fold: FloatArray


def solve(joint: JointRows, columns: IntArray, n_shared: int, prior: Prior) -> Fit:
    """Fit one joint on `columns`, of which the first `n_shared` are shared and have a prior."""
    g, r = joint.assembled(columns, n_shared, prior)
    x = regularised_solve(g, r[:, :, None])[:, :, 0]
    return Fit(columns, x[-1], x[:-1])


def held_out_residual(joint: JointRows, fit: Fit) -> FloatArray:
    """Return each row's residual (M,) in units of noise, fitted without its fold."""
    residual = joint.y.copy()
    for fold, rows in enumerate(joint.folds):
        residual[rows] -= joint.combined(rows, fit.columns, fit.by_fold[fold])
    return residual


def held_out_errors(joint: JointRows, fit: Fit) -> FloatArray:
    """Return each block's squared error (B,), in units of noise, fitted without its fold."""
    return joint.block_sums(held_out_residual(joint, fit) ** 2)


def shared_information(joint: JointRows, columns: IntArray, n_shared: int) -> Prior:
    """Return a joint's information about shared columns, its own effects eliminated."""
    g, r = joint.gram(columns), joint.right_sides[:, columns]
    s, own = slice(0, n_shared), slice(n_shared, len(columns))
    if n_shared == len(columns):
        return Prior(g[:, s, s], r[:, s])
    right = np.concatenate([g[:, own, s], r[:, own, None]], axis=2)
    solved = g[:, s, own] @ regularised_solve(g[:, own, own], right)
    return Prior(g[:, s, s] - solved[:, :, :-1], r[:, s] - solved[:, :, -1])


def covariance(joint: JointRows, fit: Fit, n_shared: int, prior: Prior,
               groups: IntArray) -> FloatArray:
    """
    Return the cluster-robust covariance of a fit's coefficients: (P, P).

    It is the jackknife over groups of blocks: without group b the coefficients change by
    -(A - G_b)^-1 (c_b - G_b x), and the covariance of the changes is that of the coefficients
    (Bell and McCaffrey, Survey Methodology 28, 2002). With many columns and few groups, a
    sandwich estimate is too small. The prior's information is not resampled.

    :param groups: (M,) the group of each row, numbered from 0 without gaps.
    """
    gram, c = _group_products(joint, fit.columns, groups)
    bread = joint.assembled(fit.columns, n_shared, prior)[0][-1]
    scores = c - gram @ fit.all_data
    n_groups = len(scores)
    ridge = _RIDGE * float(np.trace(bread)) / len(bread) * np.eye(len(bread))
    changes = np.linalg.solve(bread + ridge - gram, scores[:, :, None])[:, :, 0]
    changes -= changes.mean(axis=0)
    inverse = linalg.pinvh(bread)[:, :n_shared]
    others = inverse @ prior.information[-1] @ inverse.T
    return np.asarray(changes.T @ changes * (n_groups - 1) / n_groups + others)


def _group_products(joint: JointRows, columns: IntArray,
                    groups: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the products (G, K, K) and (G, K) of some columns in every group of rows."""
    k, count = len(columns), int(groups.max()) + 1
    gram, c = np.zeros((count, k, k)), np.zeros((count, k))
    order = np.argsort(groups, kind='stable')
    ends = np.cumsum(np.bincount(groups, minlength=count))[:-1]
    x, y = joint.x[:, columns][order], joint.y[order]
    for group, (part, torque) in enumerate(zip(np.split(x, ends), np.split(y, ends))):
        gram[group], c[group] = part.T @ part, part.T @ torque
    return gram, c


def largest_group_share(joint: JointRows, columns: IntArray, groups: IntArray) -> FloatArray:
    """Return the largest share of each column's sum of squares (P,) in a single group."""
    squares = np.stack([np.bincount(groups, joint.x[:, column] ** 2) for column in columns], 1)
    return np.asarray(squares.max(axis=0) / np.maximum(squares.sum(axis=0), 1e-300))


def absorbed(joint: JointRows, columns: IntArray, prior: Prior) -> float:
    """
    Return the share of an effect's columns that gravity explains (R^2, mean over columns).

    :param prior: information of other joints about gravity, whose columns are the first ones.
    """
    base = np.arange(prior.vector.shape[1])
    own = (joint.x[:, columns] ** 2).sum(axis=0)
    cross = joint.products(base, columns)[-1]
    gram = joint.products(base, base)[-1] + prior.information[-1]
    explained = np.einsum('ij,ij->j', cross, regularised_solve(gram, cross))
    return float(np.clip(explained / np.maximum(own, 1e-300), 0.0, 1.0).mean())


def regularised_solve(a: FloatArray, b: FloatArray) -> FloatArray:
    """Solve A x = b for stacks A (..., K, K) and b (..., K, C) with a small ridge."""
    return np.asarray(np.linalg.solve(regularised(a), b))


def regularised(a: FloatArray) -> FloatArray:
    """Return matrices A (..., K, K) with a small ridge."""
    size = np.trace(a, axis1=-2, axis2=-1) / max(a.shape[-1], 1)
    # A column may be 0 throughout a training set; the inverse of this stays finite.
    ridge = _RIDGE * np.maximum(size, 1e-200)
    return np.asarray(a + ridge[..., None, None] * np.eye(a.shape[-1]))
