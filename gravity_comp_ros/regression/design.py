"""Columns of a linearised problem and their sums of products, by joint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from itertools import pairwise

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.regression.prior import Prior
from gravity_comp_ros.regression.rows import Rows
from gravity_comp_ros.regression.term import Key, Term
import numpy as np

# Factor of a prior that keeps a parameter at its present value.
FIXED = 1e-6
# Number of candidates whose columns are summed at once, which fit into the processor's cache.
_BATCH = 32


class Design:
    """
    Rows of all joints, weighted, and the sums of products of their columns.

    For joint j, `x[j]` (K_j, R) has the P shared columns first, then those of the terms that act
    on it; `gram[j]` (K_j, K_j), `cross[j]` (K_j,) and `square[j]` are the sums of products with
    themselves and with the target `y` (N, R). Columns of terms are appended, never changed.
    `law_error` is the error of the law of a term as a share of its torque.
    """

    def __init__(self, rows: Rows, y: FloatArray, shared: FloatArray,
                 prior: Prior, weights: FloatArray, law_error: float = 0.0) -> None:
        self.root = np.ascontiguousarray(np.sqrt(weights).T)
        self.rows, self.prior, self.law_error = rows, prior, law_error
        self.n_joints, self.n_shared = y.shape[1], shared.shape[2]
        self.y = y.T * self.root
        self.x = [shared[:, j].T * self.root[j] for j in range(self.n_joints)]
        self.gram = [x @ x.T for x in self.x]
        self.cross = [x @ self.y[j] for j, x in enumerate(self.x)]
        self.square = (self.y ** 2).sum(axis=1)
        self._at: list[dict[Term, IntArray]] = [{} for _ in self.x]

    def without_rows(self, rows: BoolArray) -> Design:
        """Return the sums without some rows (R,); its rows are those left out."""
        other = copy(self)
        other.x = [x[:, rows] for x in self.x]
        other.y = self.y[:, rows]
        other.gram = [gram - x @ x.T for gram, x in zip(self.gram, other.x)]
        other.cross = [cross - x @ y for cross, x, y in zip(self.cross, other.x, other.y)]
        other.square = self.square - (other.y ** 2).sum(axis=1)
        return other

    def with_narrow(self, n_angles: int, factor: float = FIXED) -> Design:
        """Return the same sums with the prior of the first parameters narrowed by a factor."""
        other = copy(self)
        other.prior = self.prior.narrow(n_angles, factor)
        return other

    def with_wider(self, std: FloatArray) -> Design:
        """Return the same sums with standard deviations (K,) added to the first K parameters."""
        other = copy(self)
        other.prior = self.prior.wider(std)
        return other

    @property
    def n_rows(self) -> int:
        return self.y.shape[1]

    def weighted(self, j: int, term: Term) -> FloatArray:
        """Return the columns of a term on a joint, (K, R)."""
        return np.asarray(term.on(j).T * self.root[j])

    def add(self, terms: Sequence[Term]) -> None:
        """Append the columns of terms that are not in the design yet."""
        for j, at in enumerate(self._at):
            new = [term for term in terms if j in term.joints(self.n_joints) and term not in at]
            if not new:
                continue
            starts = np.cumsum([len(self.x[j]), *(term.n_columns for term in new)])
            at |= {term: np.arange(*ends) for term, ends in zip(new, pairwise(starts))}
            more = np.concatenate([self.weighted(j, term) for term in new])
            side = self.x[j] @ more.T
            self.gram[j] = np.block([[self.gram[j], side], [side.T, more @ more.T]])
            self.cross[j] = np.append(self.cross[j], more @ self.y[j])
            self.x[j] = np.concatenate([self.x[j], more])

    def selected(self, j: int, terms: Sequence[Term]) -> IntArray:
        """Return the columns of the shared part and of terms that act on a joint."""
        return np.concatenate([np.arange(self.n_shared), *(self._at[j][t] for t in terms)])


class Pool:
    """
    Candidates that act on the same joints: their C columns, and their products with the design.

    `start` (T + 1,) is the first column of each; by their number K of columns, `groups` are their
    numbers (T,), `places` (T, K) their columns, and `prior_std` (T, K) of these. `cross[j]` (C,)
    and `own[j, K]` (T, K, K) are products with the target and within each, on joint j. Products of
    candidates with each other are not needed.
    """

    def __init__(self, design: Design, joints: Sequence[int], terms: Sequence[Term]) -> None:
        self.design, self.joints, self.terms = design, tuple(joints), tuple(terms)
        sizes = np.array([term.n_columns for term in terms], dtype=np.int64)
        self.start = np.append(0, np.cumsum(sizes))
        self.groups = {int(size): np.flatnonzero(sizes == size) for size in np.unique(sizes)}
        self.places = {size: self.start[group][:, None] + np.arange(size)
                       for size, group in self.groups.items()}
        self.prior_std = {size: np.stack([self.terms[k].prior_std for k in group])
                          for size, group in self.groups.items()}
        self.log_odds = np.array([term.log_odds for term in terms])
        # The most that a prior of positive coefficients adds to a gain.
        self.most_share_allowed = np.log(2.0) * np.array([term.positive.sum() for term in terms])
        self.of_key: dict[Key, list[int]] = {}
        for k, term in enumerate(terms):
            self.of_key.setdefault(term.key, []).append(k)
        self.cross: dict[int, FloatArray] = {}
        self.own: dict[tuple[int, int], FloatArray] = {}
        self._side: dict[int, FloatArray] = {}
        for j in joints:
            self._sum(j)

    def _sum(self, j: int) -> None:
        """Sum the products on a joint: within the candidates, with the target and the design."""
        x = np.concatenate([self.design.x[j], self.design.y[j][None]])
        side = np.empty((self.start[-1], len(x)))
        self.own |= {(j, size): np.empty((len(group), size, size))
                     for size, group in self.groups.items()}
        for size, part, z in self._batches(j):
            side[self.places[size][part].ravel()] = z @ x.T
            shaped = z.reshape(-1, size, z.shape[1])
            self.own[j, size][part] = shaped @ shaped.swapaxes(1, 2)
        self._side[j], self.cross[j] = side[:, :-1], side[:, -1].copy()

    def _batches(self, j: int) -> Iterator[tuple[int, slice, FloatArray]]:
        """Yield K, a part of the candidates of K columns, and their weighted columns (T K, R)."""
        for size, group in self.groups.items():
            for start in range(0, len(group), _BATCH):
                part = slice(start, start + _BATCH)
                z = np.concatenate([self.terms[k].on(j).T for k in group[part]])
                yield size, part, np.multiply(z, self.design.root[j], out=z)

    def side(self, j: int) -> FloatArray:
        """Return the products (C, K_j) of a joint's columns with those of the design."""
        known = self._side[j].shape[1]
        new = self.design.x[j][known:]
        if len(new):
            side = np.concatenate([self._side[j], np.empty((len(self._side[j]), len(new)))],
                                  axis=1)
            for size, part, z in self._batches(j):
                side[self.places[size][part].ravel(), known:] = z @ new.T
            self._side[j] = side
        return self._side[j]
