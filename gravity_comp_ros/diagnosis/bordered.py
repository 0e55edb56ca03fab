"""
The held-out errors of a fit with one more effect, without a new fit.

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

# Residualised columns that are held at once, numbers of them times rows.
_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class Border:
    """
    Information of other joints about shared effects beside shared columns.

    `cross` (F + 1, S, C), `gram` (F + 1, C, C) and `vector` (F + 1, C) are added to the joint's
    own sums.
    """

    cross: FloatArray
    gram: FloatArray
    vector: FloatArray

    def __add__(self, other: Border) -> Border:
        return Border(self.cross + other.cross, self.gram + other.gram,
                      self.vector + other.vector)

    def of(self, columns: slice) -> Border:
        """Return the part of some of its C columns."""
        return Border(self.cross[:, :, columns], self.gram[:, columns, columns],
                      self.vector[:, columns])


@dataclass(frozen=True, eq=False)
class Stem:
    """A fit of one joint to which effects are added: its system, and its held-out residual."""

    joint: JointRows
    fit: Fit
    system: FloatArray
    residual: FloatArray


def stem(joint: JointRows, columns: IntArray, n_shared: int, prior: Prior) -> Stem:
    """Return the fit of a joint on `columns`, of which the first `n_shared` have a prior."""
    system = regularised(joint.assembled(columns, n_shared, prior)[0])
    fit = solve(joint, columns, n_shared, prior)
    return Stem(joint, fit, system, held_out_residual(joint, fit))


def border(joint: JointRows, shared: IntArray, own: IntArray, columns: IntArray) -> Border:
    """Return a joint's information about shared effects once its own effects are solved out."""
    cross, gram = joint.products(shared, columns), joint.gram(columns)
    vector = joint.aims[:, columns]
    if not len(own):
        return Border(cross, gram, vector)
    to_shared, to_effects = joint.products(shared, own), joint.products(own, columns)
    solved = regularised_solve(
        joint.gram(own), np.concatenate([to_effects, joint.aims[:, own, None]], axis=2))
    back = to_effects.transpose(0, 2, 1)
    return Border(cross - to_shared @ solved[:, :, :-1], gram - back @ solved[:, :, :-1],
                  vector - (back @ solved[:, :, -1:])[:, :, 0])


def explained(stem: Stem, effects: Sequence[IntArray],
              others: Border | None = None) -> list[float]:
    """
    Return the sum of squares that each effect takes off the fit to all data.

    It is no less than what the effect takes off held-out data, but for chance.

    :param others: as in `errors_with`; the sum is then that of all joints.
    """
    joint, fit = stem.joint, stem.fit
    columns = np.concatenate(effects)
    b, aims = joint.products(fit.columns, columns)[-1], joint.aims[-1, columns].copy()
    if others is not None:
        b[:others.cross.shape[1]] += others.cross[-1]
        aims += others.vector[-1]
    w = np.linalg.solve(stem.system[-1], b)
    aims -= b.T @ fit.all_data
    found = np.empty(len(effects))
    for group, places in _alike(effects):
        aim = aims[places]
        inner = _inner(joint, columns, places, others, b[None], w[None], slice(-1, None))[0]
        found[group] = (aim * np.linalg.solve(inner, aim[:, :, None])[:, :, 0]).sum(axis=1)
    return found.tolist()


def errors_with(stem: Stem, effects: Sequence[IntArray],
                others: Border | None = None) -> list[FloatArray]:
    """
    Return each block's squared held-out error (B,) with one effect more, for each effect.

    :param effects: the columns of each.
    :param others: information of the other joints, if the effects are shared, about their
        columns one after the other.
    """
    found: list[FloatArray] = []
    at = 0
    for group in _groups(effects):
        end = at + sum(map(len, group))
        found += _errors_with(stem, group, None if others is None else others.of(slice(at, end)))
        at = end
    return found


def _groups(effects: Sequence[IntArray]) -> list[list[IntArray]]:
    """Return effects in groups of few columns, in their order."""
    groups: list[list[IntArray]] = []
    for columns in effects:
        if not groups or sum(map(len, groups[-1])) + len(columns) > _AT_ONCE:
            groups.append([])
        groups[-1].append(columns)
    return groups


def _errors_with(stem: Stem, effects: list[IntArray],
                 others: Border | None) -> list[FloatArray]:
    joint, fit = stem.joint, stem.fit
    columns = np.concatenate(effects)
    b = joint.products(fit.columns, columns)
    aims = joint.aims[:, columns].copy()
    if others is not None:
        b[:, :others.cross.shape[1]] += others.cross
        aims += others.vector
    w: FloatArray = np.asarray(np.linalg.solve(stem.system, b), dtype=np.float64)
    coefficients = np.concatenate([fit.without, fit.all_data[None]])
    aims -= np.einsum('fkc,fk->fc', b, coefficients)
    left = _residualised(stem, columns, w)
    found = np.empty((joint.blocks.count, len(effects)))
    for group, places in _alike(effects):
        inner = _inner(joint, columns, places, others, b[:-1], w[:-1], slice(-1))
        d = np.linalg.solve(inner, aims[:-1, places, None])[..., 0]
        residual = np.repeat(stem.residual[:, None], len(group), axis=1)
        for fold, rows in enumerate(joint.folds):
            for k, column in enumerate(places.T):
                residual[rows] -= left[rows, column] * d[fold, :, k]
        found[:, group] = joint.block_sums(residual ** 2)
    return list(found.T)


def _alike(effects: Sequence[IntArray]) -> list[tuple[IntArray, IntArray]]:
    """Return the numbers (E,) of effects of equally many columns K, and their places (E, K)."""
    sizes = np.array([len(part) for part in effects])
    starts = np.cumsum(sizes) - sizes
    groups = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    return [(group, starts[group, None] + np.arange(sizes[group[0]])) for group in groups]


def _inner(joint: JointRows, columns: IntArray, places: IntArray, others: Border | None,
           b: FloatArray, w: FloatArray, fits: slice) -> FloatArray:
    """
    Return what is left of the products of effects with themselves, (F, E, K, K).

    :param places: where among `columns` those of each effect are, (E, K).
    :param b: products of the fit's columns with `columns` in each of F fits, (F, R, C).
    :param w: A^-1 b. :param fits: which fits these are.
    """
    gram = joint.own_products(columns[places])[fits]
    if others is not None:
        gram = gram + others.gram[fits][:, places[:, :, None], places[:, None]]
    mine, solved = (np.ascontiguousarray(part[:, :, places].transpose(0, 2, 1, 3))
                    for part in (b, w))
    return regularised(gram) - mine.transpose(0, 1, 3, 2) @ solved


def _residualised(stem: Stem, columns: IntArray, w: FloatArray) -> FloatArray:
    """Return C - R W (M, C) of every row, with the W of its fold left out."""
    left = stem.joint.x[:, columns]
    for fold, rows in enumerate(stem.joint.folds):
        left[rows] -= stem.joint.combined(rows, stem.fit.columns, w[fold])
    return left
