"""
Nuisance terms: friction, offset and inertia, fitted jointly so that gravity does not absorb them.

    tau_n = g_n(q) + c_n d_n + v_n qd_n + o_n + sum_j J_nj qdd_j + noise

c is Coulomb friction with the direction of motion d (`effects.motion_direction`), v viscous
friction, o an offset and J inertia. The terms are reported and stored with the model, but not
predicted: for prediction the user adds an effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
import numpy as np

COULOMB, VISCOUS, OFFSET, INERTIA = ('coulomb_friction', 'viscous_friction', 'torque_offset',
                                     'inertia')
UNITS = {COULOMB: 'N·m', VISCOUS: 'N·m·s/rad', OFFSET: 'N·m', INERTIA: 'kg·m²'}


@dataclass(frozen=True)
class NuisanceTerm:
    """
    One term: its `kind`, the `joint` whose torque contains it, value and standard deviation.

    `source` is the joint whose acceleration an inertia multiplies, None for other kinds.

    :raises DataError: if the kind is unknown or a number is not finite.
    """

    kind: str
    joint: str
    value: float
    std: float
    source: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in UNITS:
            raise DataError(f'nuisance term: unknown kind {self.kind!r}')
        if not np.isfinite([self.value, self.std]).all() or self.std < 0.0:
            raise DataError(f'nuisance term {self.kind} of {self.joint}: a number is not finite')

    @property
    def unit(self) -> str:
        return UNITS[self.kind]


@dataclass(frozen=True, eq=False)
class NuisanceTerms:
    """
    All nuisance terms of a fit.

    `width` (N,) in rad/s, `hold` (N,) in rad and `ramp` (N,), 0 or 1, describe the direction of
    motion of each joint (`effects.motion_direction.Shape`); `noise` (N,) in N·m is the residual's
    standard deviation with these terms fitted. A model without terms has empty arrays, and one of
    an earlier release no `ramp`.

    :raises DataError: if an array has a number that is negative or not finite, or `ramp` is of
        other joints than `width`.
    """

    terms: tuple[NuisanceTerm, ...] = ()
    width: FloatArray = field(default_factory=lambda: np.zeros(0))
    hold: FloatArray = field(default_factory=lambda: np.zeros(0))
    noise: FloatArray = field(default_factory=lambda: np.zeros(0))
    ramp: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for name in ('width', 'hold', 'noise', 'ramp'):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.ndim != 1 or not np.isfinite(values).all() or (values < 0.0).any():
                raise DataError(f'nuisance terms: {name} is negative or not finite')
            object.__setattr__(self, name, values)
        if not self.ramp.size:
            object.__setattr__(self, 'ramp', np.zeros(self.width.size))
        if self.ramp.size != self.width.size:
            raise DataError(f'nuisance terms: {self.ramp.size} ramps for {self.width.size} joints')

    def of(self, kind: str) -> Mapping[str, NuisanceTerm]:
        """Return the terms of one kind by joint; for inertia, those of the joint's own motion."""
        return {term.joint: term for term in self.terms
                if term.kind == kind and term.source in (None, term.joint)}

    def without(self, kind: str) -> NuisanceTerms:
        """Return the same without the terms of one kind."""
        return replace(self, terms=tuple(term for term in self.terms if term.kind != kind))

    def in_order(self, order: list[int]) -> NuisanceTerms:
        """Return the same for joints in another order."""
        if not self.width.size:
            return self
        return NuisanceTerms(self.terms, self.width[order], self.hold[order], self.noise[order],
                             self.ramp[order])

    def to_json(self) -> dict[str, Any]:
        """Return the terms for a model file."""
        return {'terms': [{'kind': t.kind, 'joint': t.joint, 'value': t.value, 'std': t.std,
                           'unit': t.unit, 'source': t.source} for t in self.terms],
                'width': self.width.tolist(), 'hold': self.hold.tolist(),
                'noise': self.noise.tolist(), 'ramp': self.ramp.tolist()}
