"""
Held-out errors of a fit with one more effect, by block elimination.

Let A x = r be the normal equations of a fit on columns R, and C the columns of an effect. With
W = A^-1 R'C, the coefficients of C are

    d = (C'C - (R'C)'W)^-1 (C'y - (R'C)'x),

and the residual becomes e - (C - R W) d (block elimination; Golub and Van Loan, Matrix
Computations, 2013, 3.2.6). W and C - R W are computed for many effects at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.evidence import (
    Fit, held_out_residual, JointRows, Prior, regularised, regularised_solve, solve)
import numpy as np

# Maximum number of residualised columns in memory at once.
_MAX_COLUMNS = 64


@dataclass(frozen=True, eq=False)
class Border:
    """
    Information of other joints about the C columns of shared effects.

    `cross` (F + 1, S, C) with the S shared columns of the fit, `gram` (F + 1, C, C) and `vector`
    (F + 1, C) are added to the joint's own sums.
    """

    cross: FloatArray
    gram: FloatArray
    vector: FloatArray

    def __add__(self, other: Border) -> Border:
        return Border(self.cross + other.cross, self.gram + other.gram,
                      self.vector + other.vector)

    def of(self, columns: slice) -> Border:
        """Return the part that belongs to some of the C columns."""
        return Border(self.cross[:, :, columns], self.gram[:, columns, columns],
                      self.vector[:, columns])


@dataclass(frozen=True, eq=False)
class BaseFit:
    """A fit of one joint to which effects are added: its matrices, and its held-out residual."""

    joint: JointRows
    fit: Fit
    system: FloatArray
    residual: FloatArray


def base_fit(joint: JointRows, columns: IntArray, n_shared: int, prior: Prior) -> BaseFit:
    """Return the fit of a joint on `columns`, of which the first `n_shared` have a prior."""
    system = regularised(joint.assembled(columns, n_shared, prior)[0])
    fit = solve(joint, columns, n_shared, prior)
    return BaseFit(joint, fit, system, held_out_residual(joint, fit))


def border(joint: JointRows, shared: IntArray, own: IntArray, columns: IntArray) -> Border:
    """Return a joint's information about shared effects, its own effects eliminated."""
    cross, gram = joint.products(shared, columns), joint.gram(columns)
    vector = joint.right_sides[:, columns]
    if not len(own):
        return Border(cross, gram, vector)
    to_shared, to_effects = joint.products(shared, own), joint.products(own, columns)
    solved = regularised_solve(
        joint.gram(own), np.concatenate([to_effects, joint.right_sides[:, own, None]], axis=2))
    back = to_effects.transpose(0, 2, 1)
    return Border(cross - to_shared @ solved[:, :, :-1], gram - back @ solved[:, :, :-1],
                  vector - (back @ solved[:, :, -1:])[:, :, 0])


def explained_squares(base_fit: BaseFit, effects: Sequence[IntArray],
                      others: Border | None = None) -> list[float]:
    """
    Return the reduction of the sum of squares by each effect, in the fit to all data.

    It is an upper bound of the reduction on held-out data, up to noise.

    :param others: as in `errors_with`; the sum is then that of all joints.
    """
    joint, fit = base_fit.joint, base_fit.fit
    columns = np.concatenate(effects)
    b = joint.products(fit.columns, columns)[-1]
    right_sides = joint.right_sides[-1, columns].copy()
    if others is not None:
        b[:others.cross.shape[1]] += others.cross[-1]
        right_sides += others.vector[-1]
    w = np.linalg.solve(base_fit.system[-1], b)
    right_sides -= b.T @ fit.all_data
    reductions = np.empty(len(effects))
    for group, places in _by_size(effects):
        right = right_sides[places]
        inner = _inner(joint, columns, places, others, b[None], w[None], slice(-1, None))[0]
        solved = np.linalg.solve(inner, right[:, :, None])[:, :, 0]
        reductions[group] = (right * solved).sum(axis=1)
    return reductions.tolist()


def errors_with(base_fit: BaseFit, effects: Sequence[IntArray],
                others: Border | None = None) -> list[FloatArray]:
    """
    Return the squared held-out error (B,) of each block with one more effect, for each effect.

    :param effects: the column numbers of each.
    :param others: information of the other joints about the concatenated columns, if the
        effects are shared.
    """
    errors: list[FloatArray] = []
    at = 0
    for group in _groups(effects):
        end = at + sum(map(len, group))
        part = None if others is None else others.of(slice(at, end))
        errors += _errors_with(base_fit, group, part)
        at = end
    return errors


def _groups(effects: Sequence[IntArray]) -> list[list[IntArray]]:
    """Return effects in groups of at most `_MAX_COLUMNS` columns, in their order."""
    groups: list[list[IntArray]] = []
    for columns in effects:
        if not groups or sum(map(len, groups[-1])) + len(columns) > _MAX_COLUMNS:
            groups.append([])
        groups[-1].append(columns)
    return groups


def _errors_with(base_fit: BaseFit, effects: list[IntArray],
                 others: Border | None) -> list[FloatArray]:
    joint, fit = base_fit.joint, base_fit.fit
    columns = np.concatenate(effects)
    b = joint.products(fit.columns, columns)
    right_sides = joint.right_sides[:, columns].copy()
    if others is not None:
        b[:, :others.cross.shape[1]] += others.cross
        right_sides += others.vector
    w: FloatArray = np.asarray(np.linalg.solve(base_fit.system, b), dtype=np.float64)
    coefficients = np.concatenate([fit.by_fold, fit.all_data[None]])
    right_sides -= np.einsum('fkc,fk->fc', b, coefficients)
    rest = _residualised(base_fit, columns, w)
    errors = np.empty((joint.blocks.count, len(effects)))
    for group, places in _by_size(effects):
        inner = _inner(joint, columns, places, others, b[:-1], w[:-1], slice(-1))
        d = np.linalg.solve(inner, right_sides[:-1, places, None])[..., 0]
        residual = np.repeat(base_fit.residual[:, None], len(group), axis=1)
        for fold, rows in enumerate(joint.folds):
            for k, column in enumerate(places.T):
                residual[rows] -= rest[rows, column] * d[fold, :, k]
        errors[:, group] = joint.block_sums(np.square(residual))
    return list(errors.T)


def _by_size(effects: Sequence[IntArray]) -> list[tuple[IntArray, IntArray]]:
    """Return effects grouped by their number of columns K: numbers (E,) and places (E, K)."""
    sizes = np.array([len(part) for part in effects])
    starts = np.cumsum(sizes) - sizes
    groups = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    return [(group, starts[group, None] + np.arange(sizes[group[0]])) for group in groups]


def _inner(joint: JointRows, columns: IntArray, places: IntArray, others: Border | None,
           b: FloatArray, w: FloatArray, fits: slice) -> FloatArray:
    """
    Return the Schur complement C'C - (R'C)'W of each effect, (F, E, K, K).

    :param places: positions of each effect's columns among `columns`, (E, K).
    :param b: products of the fit's columns with `columns` in each of F fits, (F, R, C).
    :param w: A^-1 b. :param fits: which fits these are.
    """
    gram = joint.own_products(columns[places])[fits]
    if others is not None:
        gram = gram + others.gram[fits][:, places[:, :, None], places[:, None]]
    mine, solved = (np.ascontiguousarray(part[:, :, places].transpose(0, 2, 1, 3))
                    for part in (b, w))
    return regularised(gram) - mine.transpose(0, 1, 3, 2) @ solved


def _residualised(base_fit: BaseFit, columns: IntArray, w: FloatArray) -> FloatArray:
    """Return C - R W (M, C), each row with the W of the training set without its fold."""
    rest = base_fit.joint.x[:, columns]
    for fold, rows in enumerate(base_fit.joint.folds):
        rest[rows] -= base_fit.joint.combined(rows, base_fit.fit.columns, w[fold])
    return rest
