"""Fits of all joints with any set of effects, and their held-out errors by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.bordered import (
    base_fit, BaseFit, Border, border, errors_with, explained_squares)
from gravity_comp_ros.diagnosis.candidates import AnyTrial, Candidate, Layout
from gravity_comp_ros.diagnosis.evidence import (
    absorbed, Fit, held_out_errors, held_out_residual, joint_rows, JointRows, Prior,
    shared_information, solve, with_gravity_columns)
from gravity_comp_ros.evaluation.blocks import Blocks
import numpy as np

_InformationKey = tuple[int, bytes, bytes]
# Maximum number of cached results of one kind.
_MAX_CACHED = 200
# Minimum error, relative to the torque of a joint, that is not rounding error.
_MIN_ERROR = 1e-4


@dataclass(frozen=True, eq=False)
class Fits:
    """
    The data of every joint, the columns of every candidate, and a cache of fits.

    A set of effects is a sequence of candidates in any order.
    """

    rows: tuple[JointRows, ...]
    layout: Layout
    blocks: Blocks
    _information: dict[_InformationKey, Prior] = field(
        default_factory=dict, init=False, repr=False)
    _fits: dict[tuple[int, bytes], Fit] = field(default_factory=dict, init=False, repr=False)
    _errors: dict[tuple[int, bytes], FloatArray] = field(
        default_factory=dict, init=False, repr=False)
    _errors_with: dict[tuple[int | None, bytes, bytes], FloatArray] = field(
        default_factory=dict, init=False, repr=False)
    _base_fits: dict[int, tuple[bytes, BaseFit]] = field(
        default_factory=dict, init=False, repr=False)

    @property
    def n_joints(self) -> int:
        return len(self.rows)

    def shared(self, chosen: Sequence[AnyTrial]) -> IntArray:
        """Return the shared columns: the base and the chosen effects of the arm."""
        extra = [c.columns for c in chosen if c.shared]
        return np.concatenate([np.arange(self.layout.n_base), *extra]).astype(np.int64)

    def own(self, joint: int, chosen: Sequence[AnyTrial]) -> IntArray:
        """Return the columns of a joint's own chosen effects."""
        parts = [c.columns for c in chosen if not c.shared and c.joint == joint]
        return np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64)

    def prior(self, joint: int, chosen: Sequence[AnyTrial]) -> Prior:
        """Return the information of the other joints about the shared columns."""
        shared = self.shared(chosen)
        others = [self._information_of(n, shared, self.own(n, chosen))
                  for n in range(self.n_joints) if n != joint]
        return sum(others, Prior.none(self.blocks.n_folds, len(shared)))

    def _information_of(self, n: int, shared: IntArray, own: IntArray) -> Prior:
        key = (n, shared.tobytes(), own.tobytes())
        if key not in self._information:
            if len(self._information) >= _MAX_CACHED:
                self._information.clear()
            self._information[key] = shared_information(
                self.rows[n], np.concatenate([shared, own]), len(shared))
        return self._information[key]

    def is_rounding_error(self, joint: int, chosen: Sequence[Candidate]) -> bool:
        """Return whether the held-out error of a joint is rounding error of its torque."""
        y = self.rows[joint].y
        return bool(self.errors(joint, chosen).sum() < _MIN_ERROR ** 2 * float(y @ y))

    def absorbed(self, candidate: Candidate) -> float:
        """Return the share of an effect's columns that gravity absorbs, given all joints."""
        joint = candidate.joint_index
        return absorbed(self.rows[joint], candidate.columns, self.prior(joint, []))

    def fit(self, joint: int, chosen: Sequence[AnyTrial]) -> Fit:
        """Return the fit of one joint with these effects."""
        key = (joint, self._key(chosen))
        if key not in self._fits:
            if len(self._fits) >= _MAX_CACHED:
                self._fits.clear()
            self._fits[key] = solve(self.rows[joint],
                                    *self._system(joint, _sorted(chosen)))
        return self._fits[key]

    def _system(self, joint: int, chosen: Sequence[AnyTrial]) -> tuple[IntArray, int, Prior]:
        """Return the columns of a fit, the number of shared ones, and the prior on those."""
        shared = self.shared(chosen)
        columns = np.concatenate([shared, self.own(joint, chosen)])
        return columns, len(shared), self.prior(joint, chosen)

    def errors(self, joint: int | None, chosen: Sequence[AnyTrial]) -> FloatArray:
        """Return squared held-out errors by block, of one joint or of all: (B, J)."""
        ordered, key = _sorted(chosen), self._key(chosen)
        return np.column_stack([self._errors_of(n, ordered, key) for n in self._joints(joint)])

    def _errors_of(self, joint: int, chosen: Sequence[AnyTrial], key: bytes) -> FloatArray:
        if (joint, key) not in self._errors:
            self._errors[joint, key] = held_out_errors(self.rows[joint], self.fit(joint, chosen))
        return self._errors[joint, key]

    def _key(self, chosen: Sequence[AnyTrial]) -> bytes:
        """Return a key that identifies a set of effects."""
        return b'|'.join(sorted(b'%d:' % (-1 if c.shared or c.joint is None else c.joint)
                                + c.columns.tobytes() for c in chosen))

    def errors_with_each(self, joint: int | None, chosen: Sequence[AnyTrial],
                         effects: Sequence[AnyTrial]) -> list[FloatArray]:
        """Return `errors(joint, [*chosen, effect])` for each effect."""
        ordered = _sorted(chosen)
        keys = [(joint, self._key(chosen), self._key([c])) for c in effects]
        missing = [c for key, c in zip(keys, effects) if key not in self._errors_with]
        for shared in (False, True):
            # An effect of one joint changes the errors of the others through gravity alone.
            here = [c for c in missing if c.shared == shared
                    and (shared or (joint is not None and c.joint == joint))]
            if here:
                borders = self._borders(ordered, here) if shared else None
                parts = [self._with_each(n, ordered, here, borders)
                         for n in self._joints(joint)]
                self._errors_with.update({
                    (joint, self._key(chosen), self._key([c])):
                    np.column_stack([part[k] for part in parts]) for k, c in enumerate(here)})
        return [self._errors_with[key] if key in self._errors_with
                else self.errors(joint, [*chosen, c]) for key, c in zip(keys, effects)]

    def explained_by_each(self, chosen: Sequence[AnyTrial],
                          effects: Sequence[AnyTrial]) -> list[float]:
        """Return the reduction of the sum of squares of all joints by each effect."""
        ordered = _sorted(chosen)
        reductions: dict[int, float] = {}
        for joint in {c.acts_on for c in effects}:
            here = [c for c in effects if c.acts_on == joint]
            others = None
            if joint is None and self.n_joints > 1:
                others = reduce(add, self._borders(ordered, here)[1:])
            values = explained_squares(self._base_fit(joint or 0, ordered),
                                       [c.columns for c in here], others)
            reductions.update(zip(map(id, here), values))
        return [reductions[id(c)] for c in effects]

    def _with_each(self, joint: int, chosen: Sequence[AnyTrial], effects: Sequence[AnyTrial],
                   borders: list[Border] | None) -> list[FloatArray]:
        others = None
        if borders is not None and self.n_joints > 1:
            others = reduce(add, (b for n, b in enumerate(borders) if n != joint))
        return errors_with(self._base_fit(joint, chosen), [c.columns for c in effects], others)

    def _borders(self, chosen: Sequence[AnyTrial],
                 effects: Sequence[AnyTrial]) -> list[Border]:
        """Return the information of each joint about the columns of shared effects."""
        columns = np.concatenate([c.columns for c in effects])
        return [border(self.rows[n], self.shared(chosen), self.own(n, chosen), columns)
                for n in range(self.n_joints)]

    def _base_fit(self, joint: int, chosen: Sequence[AnyTrial]) -> BaseFit:
        """Return the fit to which effects are added; the last one of each joint is cached."""
        key = self._key(chosen)
        if joint not in self._base_fits or self._base_fits[joint][0] != key:
            system = self._system(joint, chosen)
            self._base_fits[joint] = (key, base_fit(self.rows[joint], *system))
        return self._base_fits[joint][1]

    def residual(self, joint: int, chosen: Sequence[AnyTrial]) -> FloatArray:
        """Return a joint's held-out residual (M,) in N·m, in the order of the samples."""
        rows = self.rows[joint]
        residual = np.empty(len(rows.y))
        residual[rows.row_of] = held_out_residual(rows, self.fit(joint, chosen)) * rows.sigma
        return residual

    def _joints(self, joint: int | None) -> Sequence[int]:
        return range(self.n_joints) if joint is None else [joint]

    def coefficients(self, trial: AnyTrial, chosen: Sequence[AnyTrial]) -> FloatArray:
        """Return the coefficients of a chosen effect in its own units, from all data."""
        joint = trial.joint_index
        fit = self.fit(joint, chosen)
        here = np.isin(fit.columns, trial.columns)
        return np.asarray(fit.all_data[here] / self.rows[joint].scale[fit.columns[here]])

    def torque(self, joint: int, chosen: Sequence[AnyTrial],
               some: Sequence[AnyTrial]) -> FloatArray:
        """Return the torque (M,) in N·m of some chosen effects on a joint, from all data."""
        rows, fit = self.rows[joint], self.fit(joint, chosen)
        acting = [c.columns for c in some if c.shared or c.joint == joint]
        here = np.isin(fit.columns, np.concatenate([np.zeros(0, dtype=np.int64), *acting]))
        torque = np.empty(len(rows.y))
        torque[rows.row_of] = rows.x[:, fit.columns[here]] @ fit.all_data[here] * rows.sigma
        return torque

    def with_gravity(self, base: FloatArray) -> Fits:
        """Return the same fits with other columns of gravity, base (M, N, K)."""
        rows = tuple(with_gravity_columns(old, base[:, joint], self.layout.n_base)
                     for joint, old in enumerate(self.rows))
        return Fits(rows, self.layout.with_base(base.shape[2]), self.blocks)

    def refolded(self, chosen: Sequence[Candidate],
                 blocks: Blocks) -> tuple[Fits, list[Candidate]]:
        """Return fits of these effects alone with other folds, and the renumbered effects."""
        n_base, at = self.layout.n_base, self.layout.n_base
        renumbered: dict[int, Candidate] = {}
        for c in sorted(chosen, key=lambda c: not c.shared):
            if not c.shared and c.joint is not None:
                continue
            renumbered[id(c)] = replace(c, columns=np.arange(at, at + len(c.columns)))
            at += len(c.columns)
        rows, n_shared = [], at
        for joint, old in enumerate(self.rows):
            own = [c for c in chosen if not c.shared and c.joint == joint]
            at = n_shared
            for c in own:
                renumbered[id(c)] = replace(c, columns=np.arange(at, at + len(c.columns)))
                at += len(c.columns)
            used = np.concatenate([np.arange(n_base), *(c.columns for c in chosen if c.shared),
                                   *(c.columns for c in own)])
            x, y = np.empty((len(old.y), len(used))), np.empty(len(old.y))
            x[old.row_of], y[old.row_of] = old.x[:, used], old.y
            rows.append(replace(joint_rows(x, y, blocks, np.ones(len(used)), 1.0,
                                           old.ridge[used]),
                                scale=old.scale[used], sigma=old.sigma))
        layout = replace(self.layout, candidates=tuple(renumbered.values()), alternatives=(),
                         unknown=(), structure_tests=())
        return Fits(tuple(rows), layout, blocks), [renumbered[id(c)] for c in chosen]


def _sorted(chosen: Sequence[AnyTrial]) -> list[AnyTrial]:
    return sorted(chosen, key=lambda c: (not c.shared, -1 if c.joint is None else c.joint,
                                         int(c.columns[0])))
