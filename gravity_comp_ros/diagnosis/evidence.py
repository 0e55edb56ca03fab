"""
Least squares with effects, from Gram matrices of blocks.

The torque of joint n is modelled as

    tau_n = S_n s + L_n l_n,

s are the coefficients that all joints share (the energy's weights, effects of the whole arm) and
l_n those of the joint's own effects. All products of columns are summed once, block by block; a
fit without some blocks, the error on them, and the covariance are then sums of small matrices.
What the other joints tell about s enters joint n's fit as a prior: their Schur complements.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.evaluation.blocks import Blocks
import numpy as np
from scipy import linalg

# Ridge relative to the mean diagonal: decides only what the data leaves open.
_RIDGE = 1e-9


@dataclass(frozen=True)
class JointGram:
    """
    One joint's products of columns, block by block, in units of its noise.

    `gram` (P, P, B), `c` (P, B) and `yy` (B,) hold X.T X, X.T y and y.T y with columns divided
    by `scale` (P,) and rows by `sigma` N·m: a coefficient is its scaled one over `scale`. The
    blocks come last, so that taking some columns copies whole rows of memory. `training`
    (F + 1, P, P) and `aims` (F + 1, P) are the sums without each fold, and over all blocks.
    `ridge` (P,) is added to the diagonal, for columns with a prior of their own.
    """

    gram: FloatArray
    c: FloatArray
    yy: FloatArray
    training: FloatArray
    aims: FloatArray
    scale: FloatArray
    sigma: float
    ridge: FloatArray

    def blockwise(self, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the products (K, K, B) and (K, B) of some columns in every block."""
        return self.gram[columns[:, None], columns], self.c[columns]

    def system(self, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the normal equations (F + 1, K, K) and (F + 1, K) of every training set."""
        g = self.training[:, columns[:, None], columns] + np.diag(self.ridge[columns])
        return g, self.aims[:, columns]


def joint_gram(x: FloatArray, y: FloatArray, blocks: Blocks, scale: FloatArray,
               sigma: float, prior_samples: FloatArray) -> JointGram:
    """
    Sum the products of columns X (M, P) with themselves and y (M,) over blocks.

    :param scale: (P,) what columns are divided by; the same in all joints for shared columns,
        so that their scaled coefficients mean the same everywhere.
    :param prior_samples: (P,) how many samples, in which a column is 1, a prior is worth that
        holds its coefficient near 0 within `sigma`; 0 for none.
    """
    x, y = x / scale / sigma, y / sigma
    p = x.shape[1]
    gram, c = np.empty((blocks.count, p, p)), np.empty((blocks.count, p))
    for b in range(blocks.count):
        rows = slice(blocks.starts[b], blocks.starts[b + 1])
        gram[b], c[b] = x[rows].T @ x[rows], x[rows].T @ y[rows]
    ridge = prior_samples / (scale * sigma) ** 2
    return JointGram(np.ascontiguousarray(np.moveaxis(gram, 0, -1)), c.T.copy(),
                     blocks.sums(y ** 2), training_sums(gram, blocks), training_sums(c, blocks),
                     scale, sigma, ridge)


@dataclass(frozen=True)
class Prior:
    """
    What other joints tell about shared columns: information (F, S, S) and vector (F, S).

    One for each of the F folds left out, and a last one with all data.
    """

    information: FloatArray
    vector: FloatArray


@dataclass(frozen=True)
class Fit:
    """Coefficients (P,) in scaled columns: all data, and with each fold left out (F, P)."""

    columns: IntArray
    all_data: FloatArray
    without: FloatArray


def training_sums(values: FloatArray, blocks: Blocks) -> FloatArray:
    """Return sums over blocks (B, ...) without each fold, and over all: (F + 1, ...)."""
    total = values.sum(axis=0)
    left = [total - values[blocks.fold == f].sum(axis=0) for f in range(blocks.n_folds)]
    return np.stack([*left, total])


def solve(joint: JointGram, columns: IntArray, n_shared: int, prior: Prior) -> Fit:
    """Fit one joint on `columns`, of which the first `n_shared` are shared and have a prior."""
    g, r = joint.system(columns)
    g[:, :n_shared, :n_shared] += prior.information
    r[:, :n_shared] += prior.vector
    x = _solve(g, r[:, :, None])[:, :, 0]
    return Fit(columns, x[-1], x[:-1])


def held_out_errors(joint: JointGram, fit: Fit, blocks: Blocks) -> FloatArray:
    """Return each block's squared error (B,), in units of noise, fitted without its fold."""
    gram, c = joint.blockwise(fit.columns)
    x = fit.without[blocks.fold].T
    return np.asarray(joint.yy + ((np.einsum('pqb,qb->pb', gram, x) - 2.0 * c) * x).sum(axis=0))


def shared_information(joint: JointGram, columns: IntArray, n_shared: int) -> Prior:
    """Return what a joint tells about the shared columns once its own effects are solved out."""
    g, r = joint.system(columns)
    s, own = slice(0, n_shared), slice(n_shared, len(columns))
    if n_shared == len(columns):
        return Prior(g[:, s, s], r[:, s])
    right = np.concatenate([g[:, own, s], r[:, own, None]], axis=2)
    solved = g[:, s, own] @ _solve(g[:, own, own], right)
    return Prior(g[:, s, s] - solved[:, :, :-1], r[:, s] - solved[:, :, -1])


def covariance(joint: JointGram, fit: Fit, n_shared: int, prior: Prior,
               groups: IntArray) -> FloatArray:
    """
    Return how sure a fit's coefficients are, robust to correlation within groups: (P, P).

    The jackknife over groups of blocks: without group b the coefficients move by
    -(A - G_b)^-1 (c_b - G_b x), and the spread of the moves is that of the coefficients (Bell
    and McCaffrey, Survey Methodology 28, 2002). Where columns are many and groups few, a
    sandwich would be too narrow. The prior's information stands as it is.

    :param groups: (B,) the group of each block, numbered from 0 without gaps.
    """
    gram, c = (_summed(np.moveaxis(part, -1, 0), groups)
               for part in joint.blockwise(fit.columns))
    bread = joint.system(fit.columns)[0][-1]
    bread[:n_shared, :n_shared] += prior.information[-1]
    scores = c - gram @ fit.all_data
    n_blocks = len(scores)
    ridge = _RIDGE * float(np.trace(bread)) / len(bread) * np.eye(len(bread))
    moves = np.linalg.solve(bread + ridge - gram, scores[:, :, None])[:, :, 0]
    moves -= moves.mean(axis=0)
    inverse = linalg.pinvh(bread)[:, :n_shared]
    others = inverse @ prior.information[-1] @ inverse.T
    return np.asarray(moves.T @ moves * (n_blocks - 1) / n_blocks + others)


def largest_part(joint: JointGram, columns: IntArray, groups: IntArray) -> FloatArray:
    """Return the share of each column's square (P,) that the group with most of it has."""
    squares = _summed(joint.gram[columns, columns].T, groups)
    return np.asarray(squares.max(axis=0) / np.maximum(squares.sum(axis=0), 1e-300))


def _summed(values: FloatArray, groups: IntArray) -> FloatArray:
    """Return the sums over blocks (B, ...) of each group."""
    sums = np.zeros((int(groups.max()) + 1, *values.shape[1:]))
    np.add.at(sums, groups, values)
    return sums


def absorbed(joint: JointGram, base: IntArray, columns: IntArray) -> float:
    """Return which share of an effect's columns (mean over them) the base columns imitate."""
    total = joint.training[-1]
    own = np.diag(total)[columns]
    cross = total[np.ix_(base, columns)]
    explained = np.einsum('ij,ij->j', cross, _solve(total[np.ix_(base, base)], cross))
    return float(np.clip(explained / np.maximum(own, 1e-300), 0.0, 1.0).mean())


def _solve(a: FloatArray, b: FloatArray) -> FloatArray:
    """Solve A x = b for stacks A (..., K, K) and b (..., K, C), a little towards 0."""
    size = np.trace(a, axis1=-2, axis2=-1) / max(a.shape[-1], 1)
    # A column may be 0 all through a training set: 1 over this is still a number.
    ridge = _RIDGE * np.maximum(size, 1e-200)
    return np.asarray(np.linalg.solve(a + ridge[..., None, None] * np.eye(a.shape[-1]), b))
