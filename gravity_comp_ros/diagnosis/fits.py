"""Fits of all joints with any set of effects, and their held-out errors block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.bordered import (
    Border, border, errors_with, explained, Stem, stem)
from gravity_comp_ros.diagnosis.candidates import AnyTrial, Candidate, Layout
from gravity_comp_ros.diagnosis.evidence import (
    absorbed, Fit, held_out_errors, held_out_residual, joint_rows, JointRows, Prior, rebased,
    shared_information, solve)
from gravity_comp_ros.evaluation.blocks import Blocks
import numpy as np

_Key = tuple[int, bytes, bytes]
# Matrices that are kept; those of another set of effects are made again.
_KEPT = 200


@dataclass(frozen=True, eq=False)
class Fits:
    """
    The rows of every joint, the columns of every candidate, and what was computed from them.

    A set of effects is a sequence of candidates; the order changes nothing.
    """

    rows: tuple[JointRows, ...]
    layout: Layout
    blocks: Blocks
    _information: dict[_Key, Prior] = field(default_factory=dict, init=False, repr=False)
    _fits: dict[tuple[int, bytes], Fit] = field(default_factory=dict, init=False, repr=False)
    _errors: dict[tuple[int, bytes], FloatArray] = field(
        default_factory=dict, init=False, repr=False)
    _with: dict[tuple[int | None, bytes, bytes], FloatArray] = field(
        default_factory=dict, init=False, repr=False)
    _stems: dict[int, tuple[bytes, Stem]] = field(default_factory=dict, init=False, repr=False)

    @property
    def n_joints(self) -> int:
        return len(self.rows)

    def shared(self, chosen: Sequence[AnyTrial]) -> IntArray:
        """Return the shared columns in use: the base and chosen effects of the arm."""
        extra = [c.columns for c in chosen if c.shared]
        return np.concatenate([np.arange(self.layout.n_base), *extra]).astype(np.int64)

    def own(self, joint: int, chosen: Sequence[AnyTrial]) -> IntArray:
        """Return a joint's own columns in use."""
        parts = [c.columns for c in chosen if not c.shared and c.joint == joint]
        return np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64)

    def prior(self, joint: int, chosen: Sequence[AnyTrial]) -> Prior:
        """Return the information of the other joints about the shared columns."""
        shared = self.shared(chosen)
        others = [self._informed(n, shared, self.own(n, chosen))
                  for n in range(self.n_joints) if n != joint]
        return sum(others, Prior.none(self.blocks.n_folds, len(shared)))

    def _informed(self, n: int, shared: IntArray, own: IntArray) -> Prior:
        key = (n, shared.tobytes(), own.tobytes())
        if key not in self._information:
            if len(self._information) >= _KEPT:
                self._information.clear()
            self._information[key] = shared_information(
                self.rows[n], np.concatenate([shared, own]), len(shared))
        return self._information[key]

    def absorbed(self, candidate: Candidate) -> float:
        """Return the share of an effect that gravity can imitate, given the other joints."""
        place = candidate.place
        return absorbed(self.rows[place], candidate.columns, self.prior(place, []))

    def fit(self, joint: int, chosen: Sequence[AnyTrial]) -> Fit:
        """Return the fit of one joint with these effects."""
        key = (joint, self._key(chosen))
        if key not in self._fits:
            if len(self._fits) >= _KEPT:
                self._fits.clear()
            self._fits[key] = solve(self.rows[joint],
                                    *self._asked(joint, _in_one_order(chosen)))
        return self._fits[key]

    def _asked(self, joint: int, chosen: Sequence[AnyTrial]) -> tuple[IntArray, int, Prior]:
        """Return the columns of a fit, how many of them are shared, and the prior on those."""
        shared = self.shared(chosen)
        columns = np.concatenate([shared, self.own(joint, chosen)])
        return columns, len(shared), self.prior(joint, chosen)

    def errors(self, joint: int | None, chosen: Sequence[AnyTrial]) -> FloatArray:
        """Return held-out errors block by block, of one joint or of all: (B, J)."""
        ordered, key = _in_one_order(chosen), self._key(chosen)
        return np.column_stack([self._errors_of(n, ordered, key) for n in self._joints(joint)])

    def _errors_of(self, joint: int, chosen: Sequence[AnyTrial], key: bytes) -> FloatArray:
        place = (joint, key)
        if place not in self._errors:
            self._errors[place] = held_out_errors(self.rows[joint], self.fit(joint, chosen))
        return self._errors[place]

    def _key(self, chosen: Sequence[AnyTrial]) -> bytes:
        """Return what tells one set of effects from another."""
        return b'|'.join(sorted(b'%d:' % (-1 if c.shared or c.joint is None else c.joint)
                                + c.columns.tobytes() for c in chosen))

    def errors_with_each(self, joint: int | None, chosen: Sequence[AnyTrial],
                         effects: Sequence[AnyTrial]) -> list[FloatArray]:
        """Return `errors(joint, [*chosen, effect])` for each effect."""
        ordered = _in_one_order(chosen)
        keys = [(joint, self._key(chosen), self._key([c])) for c in effects]
        missing = [c for key, c in zip(keys, effects) if key not in self._with]
        for shared in (False, True):
            # Elsewhere than on its own joint an effect acts by what it leaves to gravity.
            here = [c for c in missing if c.shared == shared
                    and (shared or (joint is not None and c.joint == joint))]
            if here:
                borders = self._borders(ordered, here) if shared else None
                parts = [self._with_each(n, ordered, here, borders)
                         for n in self._joints(joint)]
                self._with.update({
                    (joint, self._key(chosen), self._key([c])):
                    np.column_stack([part[k] for part in parts]) for k, c in enumerate(here)})
        return [self._with[key] if key in self._with else self.errors(joint, [*chosen, c])
                for key, c in zip(keys, effects)]

    def explained_by_each(self, chosen: Sequence[AnyTrial],
                          effects: Sequence[AnyTrial]) -> list[float]:
        """Return the sum of squares that each effect takes off the fits of all joints."""
        ordered = _in_one_order(chosen)
        found: dict[int, float] = {}
        for place in {c.acts_on for c in effects}:
            here = [c for c in effects if c.acts_on == place]
            others = None
            if place is None and self.n_joints > 1:
                others = reduce(add, self._borders(ordered, here)[1:])
            values = explained(self._stem(place or 0, ordered), [c.columns for c in here], others)
            found.update(zip(map(id, here), values))
        return [found[id(c)] for c in effects]

    def _with_each(self, joint: int, chosen: Sequence[AnyTrial], effects: Sequence[AnyTrial],
                   borders: list[Border] | None) -> list[FloatArray]:
        others = None
        if borders is not None and self.n_joints > 1:
            others = reduce(add, (b for n, b in enumerate(borders) if n != joint))
        return errors_with(self._stem(joint, chosen), [c.columns for c in effects], others)

    def _borders(self, chosen: Sequence[AnyTrial],
                 effects: Sequence[AnyTrial]) -> list[Border]:
        """Return the information of each joint about the columns of shared effects."""
        columns = np.concatenate([c.columns for c in effects])
        return [border(self.rows[n], self.shared(chosen), self.own(n, chosen), columns)
                for n in range(self.n_joints)]

    def _stem(self, joint: int, chosen: Sequence[AnyTrial]) -> Stem:
        """Return the fit to add effects to; the last one of each joint is kept."""
        key = self._key(chosen)
        if joint not in self._stems or self._stems[joint][0] != key:
            self._stems[joint] = (key, stem(self.rows[joint], *self._asked(joint, chosen)))
        return self._stems[joint][1]

    def residual(self, joint: int, chosen: Sequence[AnyTrial]) -> FloatArray:
        """Return a joint's held-out residual (M,) in N·m, in the order of the samples."""
        rows = self.rows[joint]
        residual = np.empty(len(rows.y))
        residual[rows.row_of] = held_out_residual(rows, self.fit(joint, chosen)) * rows.sigma
        return residual

    def _joints(self, joint: int | None) -> Sequence[int]:
        return range(self.n_joints) if joint is None else [joint]

    def coefficients(self, trial: AnyTrial, chosen: Sequence[AnyTrial]) -> FloatArray:
        """Return a chosen effect's coefficients in its own units, from all data."""
        joint = trial.place
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

    def beside(self, base: FloatArray) -> Fits:
        """Return the same fits beside other columns of gravity, base (M, N, K)."""
        rows = tuple(rebased(old, base[:, joint], self.layout.n_base)
                     for joint, old in enumerate(self.rows))
        return Fits(rows, self.layout.with_base(base.shape[2]), self.blocks)

    def refolded(self, chosen: Sequence[Candidate],
                 blocks: Blocks) -> tuple[Fits, list[Candidate]]:
        """Return fits of these effects alone with other folds, and the effects in them."""
        n_base, at = self.layout.n_base, self.layout.n_base
        moved: dict[int, Candidate] = {}
        for c in sorted(chosen, key=lambda c: not c.shared):
            if not c.shared and c.joint is not None:
                continue
            moved[id(c)] = replace(c, columns=np.arange(at, at + len(c.columns)))
            at += len(c.columns)
        rows, n_shared = [], at
        for joint, old in enumerate(self.rows):
            own = [c for c in chosen if not c.shared and c.joint == joint]
            at = n_shared
            for c in own:
                moved[id(c)] = replace(c, columns=np.arange(at, at + len(c.columns)))
                at += len(c.columns)
            used = np.concatenate([np.arange(n_base), *(c.columns for c in chosen if c.shared),
                                   *(c.columns for c in own)])
            x, y = np.empty((len(old.y), len(used))), np.empty(len(old.y))
            x[old.row_of], y[old.row_of] = old.x[:, used], old.y
            rows.append(replace(joint_rows(x, y, blocks, np.ones(len(used)), 1.0,
                                           old.ridge[used]),
                                scale=old.scale[used], sigma=old.sigma))
        layout = replace(self.layout, candidates=tuple(moved.values()), alternatives=(),
                         shapes=(), laws=())
        return Fits(tuple(rows), layout, blocks), [moved[id(c)] for c in chosen]


def _in_one_order(chosen: Sequence[AnyTrial]) -> list[AnyTrial]:
    return sorted(chosen, key=lambda c: (not c.shared, -1 if c.joint is None else c.joint,
                                         int(c.columns[0])))
