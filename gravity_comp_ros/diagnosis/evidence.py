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

from gravity_comp_ros.diagnosis.blocks import Blocks
from gravity_comp_ros.samples import FloatArray, IntArray
import numpy as np
from scipy import linalg

# Ridge relative to the mean diagonal: decides only what the data leaves open.
_RIDGE = 1e-9


@dataclass(frozen=True)
class JointGram:
    """
    One joint's products of columns, block by block, in units of its noise.

    `gram` (B, P, P), `c` (B, P) and `yy` (B,) hold X.T X, X.T y and y.T y with columns divided
    by `scale` (P,) and rows by `sigma` N·m: a coefficient is its scaled one over `scale`.
    `ridge` (P,) is added to the diagonal, for columns with a prior of their own.
    """

    gram: FloatArray
    c: FloatArray
    yy: FloatArray
    scale: FloatArray
    sigma: float
    ridge: FloatArray

    def take(self, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the block Grams and products of some columns."""
        return self.gram[:, columns[:, None], columns[None, :]], self.c[:, columns]


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
    return JointGram(gram, c, blocks.sums(y ** 2), scale, sigma, ridge)


@dataclass(frozen=True)
class Prior:
    """What other joints tell about shared columns: information (F, S, S) and vector (F, S).

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


def solve(joint: JointGram, columns: IntArray, n_shared: int, prior: Prior,
          blocks: Blocks) -> Fit:
    """Fit one joint on `columns`, of which the first `n_shared` are shared and have a prior."""
    gram, c = joint.take(columns)
    g, r = training_sums(gram, blocks), training_sums(c, blocks)
    g[:, :n_shared, :n_shared] += prior.information
    r[:, :n_shared] += prior.vector
    g += np.diag(joint.ridge[columns])
    x = np.stack([_solve(a, b) for a, b in zip(g, r)])
    return Fit(columns, x[-1], x[:-1])


def held_out_errors(joint: JointGram, fit: Fit, blocks: Blocks) -> FloatArray:
    """Return each block's squared error (B,), in units of noise, fitted without its fold."""
    gram, c = joint.take(fit.columns)
    x = fit.without[blocks.fold]
    return joint.yy - 2.0 * np.einsum('bp,bp->b', x, c) + np.einsum(
        'bp,bpq,bq->b', x, gram, x, optimize=True)


def shared_information(joint: JointGram, columns: IntArray, n_shared: int,
                       blocks: Blocks) -> Prior:
    """Return what a joint tells about the shared columns once its own effects are solved out."""
    gram, c = joint.take(columns)
    g, r = training_sums(gram, blocks), training_sums(c, blocks)
    g += np.diag(joint.ridge[columns])
    s, own = slice(0, n_shared), slice(n_shared, len(columns))
    if n_shared == len(columns):
        return Prior(g[:, s, s], r[:, s])
    information, vector = np.empty(g[:, s, s].shape), np.empty(r[:, s].shape)
    for k in range(len(g)):
        solved = _solve(g[k, own, own], np.column_stack([g[k, own, s], r[k, own]]))
        information[k] = g[k, s, s] - g[k, s, own] @ solved[:, :-1]
        vector[k] = r[k, s] - g[k, s, own] @ solved[:, -1]
    return Prior(information, vector)


def covariance(joint: JointGram, fit: Fit, n_shared: int, prior: Prior) -> FloatArray:
    """
    Return how sure a fit's coefficients are, robust to correlation within blocks: (P, P).

    The jackknife over blocks: without block b the coefficients move by
    -(A - G_b)^-1 (c_b - G_b x), and the spread of the moves is that of the coefficients (Bell
    and McCaffrey, Survey Methodology 28, 2002). Where columns are many and blocks few, a
    sandwich would be too narrow. The prior's information stands as it is.
    """
    gram, c = joint.take(fit.columns)
    bread = gram.sum(axis=0) + np.diag(joint.ridge[fit.columns])
    bread[:n_shared, :n_shared] += prior.information[-1]
    scores = c - gram @ fit.all_data
    n_blocks = len(scores)
    ridge = _RIDGE * float(np.trace(bread)) / len(bread) * np.eye(len(bread))
    moves = np.linalg.solve(bread + ridge - gram, scores[:, :, None])[:, :, 0]
    moves -= moves.mean(axis=0)
    inverse = linalg.pinvh(bread)[:, :n_shared]
    others = inverse @ prior.information[-1] @ inverse.T
    return np.asarray(moves.T @ moves * (n_blocks - 1) / n_blocks + others)


def absorbed(joint: JointGram, base: IntArray, columns: IntArray) -> float:
    """Return which share of an effect's columns (mean over them) the base columns imitate."""
    total = joint.gram.sum(axis=0)
    own = np.diag(total)[columns]
    cross = total[np.ix_(base, columns)]
    explained = np.einsum('ij,ij->j', cross, _solve(total[np.ix_(base, base)], cross))
    return float(np.clip(explained / np.maximum(own, 1e-300), 0.0, 1.0).mean())


def _solve(a: FloatArray, b: FloatArray) -> FloatArray:
    ridge = _RIDGE * max(float(np.trace(a)) / max(len(a), 1), 1e-300)
    damped = a + ridge * np.eye(len(a))
    try:
        factor = linalg.cho_factor(damped, check_finite=False)
        return np.asarray(linalg.cho_solve(factor, b, check_finite=False))
    except linalg.LinAlgError:
        return np.asarray(linalg.lstsq(damped, b, check_finite=False)[0])
