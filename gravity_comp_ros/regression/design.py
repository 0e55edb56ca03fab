"""Columns of a linearised problem and their sums of products, by joint."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from functools import cached_property

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
    """

    def __init__(self, rows: Rows, y: FloatArray, shared: FloatArray,
                 prior: Prior, weights: FloatArray) -> None:
        self.root = np.ascontiguousarray(np.sqrt(weights).T)
        self.rows, self.prior = rows, prior
        self.n_joints, self.n_shared = y.shape[1], shared.shape[2]
        self.y = y.T * self.root
        self.x = [shared[:, j].T * self.root[j] for j in range(self.n_joints)]
        self.gram = [x @ x.T for x in self.x]
        self.cross = [x @ self.y[j] for j, x in enumerate(self.x)]
        self.square = (self.y ** 2).sum(axis=1)
        self._at: list[dict[Term, slice]] = [{} for _ in self.x]

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

    @property
    def n_rows(self) -> int:
        return self.y.shape[1]

    def weighted(self, j: int, term: Term) -> FloatArray:
        """Return the columns of a term on a joint, (K, R)."""
        return np.asarray(term.on(j).T * self.root[j])

    def add(self, terms: Iterable[Term]) -> None:
        """Append the columns of terms that are not in the design yet."""
        for term in terms:
            for j in term.joints(self.n_joints):
                if term not in self._at[j]:
                    self._append(j, term)

    def _append(self, j: int, term: Term) -> None:
        start, more = len(self.x[j]), self.weighted(j, term)
        self._at[j][term] = slice(start, start + len(more))
        side = self.x[j] @ more.T
        self.gram[j] = np.block([[self.gram[j], side], [side.T, more @ more.T]])
        self.cross[j] = np.append(self.cross[j], more @ self.y[j])
        self.x[j] = np.concatenate([self.x[j], more])

    def selected(self, j: int, terms: Sequence[Term]) -> IntArray:
        """Return the columns of the shared part and of terms that act on a joint."""
        at = self._at[j]
        parts = [np.arange(self.n_shared)]
        parts += [np.arange(at[term].start, at[term].stop) for term in terms]
        return np.concatenate(parts)


class Pool:
    """
    Candidates that act on the same joints: their columns, and their products with the design.

    Products of candidates with each other are needed within a candidate only.
    """

    def __init__(self, design: Design, joints: Sequence[int], terms: Sequence[Term]) -> None:
        self.design, self.joints, self.terms = design, tuple(joints), tuple(terms)
        self.start = np.cumsum([0, *(term.n_columns for term in terms)])
        sizes = np.diff(self.start)
        self._groups = {int(size): np.flatnonzero(sizes == size) for size in np.unique(sizes)}
        count = int(self.start[-1])
        self.cross = {j: np.empty(count) for j in joints}
        self._side = {j: np.empty((count, 0)) for j in joints}
        self._own = {(j, size): np.empty((len(group), size, size))
                     for j in joints for size, group in self._groups.items()}
        self._sum()

    def _sum(self) -> None:
        """Sum the products within the candidates, with the target and with the design."""
        for j in self.joints:
            x = np.concatenate([self.design.x[j], self.design.y[j][None]])
            side = np.empty((len(self.cross[j]), len(x)))
            for size, numbers, z in self._batches(j):
                side[self._columns(numbers, size)] = z @ x.T
                shaped = z.reshape(-1, size, z.shape[1])
                self._own[j, size][np.searchsorted(self._groups[size], numbers)] = (
                    shaped @ shaped.swapaxes(1, 2))
            self._side[j], self.cross[j] = side[:, :-1], side[:, -1].copy()

    def _batches(self, j: int) -> Iterator[tuple[int, IntArray, FloatArray]]:
        """Yield weighted columns (T K, R) of T candidates of K columns: K and their numbers."""
        for size, group in self._groups.items():
            for numbers in np.split(group, range(_BATCH, len(group), _BATCH)):
                z = np.concatenate([self.terms[k].on(j).T for k in numbers])
                yield size, numbers, np.multiply(z, self.design.root[j], out=z)

    def _columns(self, numbers: IntArray, size: int) -> IntArray:
        """Return the columns of candidates of `size` columns."""
        return np.asarray((self.start[numbers][:, None] + np.arange(size)).ravel())

    def places(self, size: int) -> IntArray:
        """Return the columns (T, K) of each candidate of K columns."""
        return self._columns(self._groups[size], size).reshape(-1, size)

    def side(self, j: int) -> FloatArray:
        """Return the products (C, K_j) of a joint's columns with those of the design."""
        known = self._side[j].shape[1]
        new = self.design.x[j][known:]
        if len(new):
            side = np.concatenate([self._side[j], np.empty((len(self.cross[j]), len(new)))],
                                  axis=1)
            for size, numbers, z in self._batches(j):
                side[self._columns(numbers, size), known:] = z @ new.T
            self._side[j] = side
        return self._side[j]

    @cached_property
    def prior_std(self) -> Mapping[int, FloatArray]:
        """Return the prior standard deviations (T, K) of the candidates of K columns, by K."""
        return {size: np.stack([self.terms[k].prior_std for k in group])
                for size, group in self._groups.items()}

    @cached_property
    def log_odds(self) -> FloatArray:
        """Return the prior log odds (T,) of all candidates."""
        return np.array([term.log_odds for term in self.terms])

    @cached_property
    def of_key(self) -> Mapping[Key, Sequence[int]]:
        """Return the numbers of the candidates of each effect."""
        numbers: dict[Key, list[int]] = {}
        for k, term in enumerate(self.terms):
            numbers.setdefault(term.key, []).append(k)
        return numbers

    @cached_property
    def most_share_allowed(self) -> FloatArray:
        """Return the most (C,) that a prior of positive coefficients adds to a gain."""
        return np.array([t.n_columns * np.log(2.0) if t.effect.why_not_negative else 0.0
                         for t in self.terms])

    def groups(self) -> Mapping[int, IntArray]:
        """Return the numbers of the candidates by their number of columns."""
        return self._groups

    def own(self, j: int, size: int) -> FloatArray:
        """Return the products (T, K, K) within each candidate of K columns (`groups`)."""
        return self._own[j, size]
