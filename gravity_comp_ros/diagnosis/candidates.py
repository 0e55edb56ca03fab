"""
Candidate effects: the columns of every effect that this motion excites, and of gravity.

Shared columns come first: those of gravity, then of effects that act on several joints. Each
joint then has its own effects. Values of the nonlinear parameters of an effect (a frequency, a
distance) are compared on the residual of gravity, friction, offset and inertia; the best three
are kept. Their number is recorded for the correction of p-values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.nonparametric import UnknownTorque
from gravity_comp_ros.diagnosis.nuisance import nuisance
from gravity_comp_ros.diagnosis.structure_tests import StructureTest
from gravity_comp_ros.effects.effect import AlternativeModel, Effect, Regressor, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

_SETTINGS_KEPT = 3
# Relative eigenvalue of a Gram matrix below which a direction counts as rounding error.
_RANK = 1e-9
# Number of samples used to compare settings.
_SCAN_ROWS = 2500
R = TypeVar('R', bound=Regressor)
R_co = TypeVar('R_co', bound=Regressor, covariant=True)
T = TypeVar('T', bound='AnyTrial')


@dataclass(frozen=True, eq=False)
class Trial(Generic[R_co]):
    """
    One regressor with one setting, and its column numbers.

    `joint` is its joint, None for the whole arm; `shared` is True for shared columns; `tried` is
    the number of settings that were compared.
    """

    regressor: R_co
    joint: int | None
    setting: Setting
    columns: IntArray
    shared: bool
    tried: int

    @property
    def key(self) -> tuple[str, int | None]:
        """Return name and joint; only one setting of an effect can be chosen."""
        return self.regressor.name, self.joint

    @property
    def joint_index(self) -> int:
        """Return the joint number for the regressor's methods, 0 for the whole arm."""
        return self.joint or 0

    @property
    def acts_on(self) -> int | None:
        """Return the only joint whose torque it changes, None for several joints."""
        return None if self.shared else self.joint


AnyTrial = Trial[Regressor]


class Candidate(Trial[Effect]):
    """One effect with one setting, which can become a finding."""

    @property
    def effect(self) -> Effect:
        return self.regressor

    @property
    def complexity(self) -> int:
        """Return the number of coefficients and of scanned nonlinear parameters."""
        return len(self.columns) + self.effect.n_scanned(self.setting)

    def n_free(self, motion: Motion) -> int:
        """Return the number of coefficients without a prior."""
        prior_std = self.effect.spread(motion, self.joint_index, self.setting)
        return len(self.columns) if prior_std is None else int(np.isinf(prior_std).sum())


@dataclass(frozen=True, eq=False)
class Layout:
    """
    Order of the columns: gravity, shared effects, then the own effects of each joint.

    `n_base` columns are of gravity. `untestable` maps an effect and a joint to the reason why
    this motion does not excite it. `alternatives`, `unknown` torques and `structure_tests` are
    regressors that cannot become findings. Columns of a joint from number `n_core` (N,) on are
    used with the final selection only.
    """

    n_base: int
    candidates: tuple[Candidate, ...]
    alternatives: tuple[Trial[AlternativeModel], ...] = ()
    unknown: tuple[Trial[UnknownTorque], ...] = ()
    structure_tests: tuple[Trial[StructureTest], ...] = ()
    untestable: Mapping[tuple[str, int | None], str] = field(default_factory=dict)
    n_core: tuple[int, ...] = ()

    def with_base(self, n_base: int) -> Layout:
        """Return the layout with another number of columns of gravity."""
        shift = n_base - self.n_base
        return replace(self, n_base=n_base, n_core=tuple(n + shift for n in self.n_core),
                       candidates=_shifted(self.candidates, shift, shift),
                       alternatives=_shifted(self.alternatives, shift, shift),
                       unknown=_shifted(self.unknown, shift, shift),
                       structure_tests=_shifted(self.structure_tests, shift, shift))


def _shifted(trials: Sequence[T], shared: int, own: int) -> tuple[T, ...]:
    """Return trials with their column numbers shifted by `shared` or `own`."""
    return tuple(replace(t, columns=t.columns + (shared if t.shared else own)) for t in trials)


@dataclass(frozen=True, eq=False)
class Columns:
    """All columns: `shared`, a list of (M, N, K), and `own`, for each joint a list of (M, K)."""

    layout: Layout
    shared: list[FloatArray]
    own: tuple[list[FloatArray], ...]


def build(motion: Motion, base: FloatArray, effects: Sequence[Effect],
          alternatives: Sequence[AlternativeModel] = (), unknown: Sequence[UnknownTorque] = (),
          structure_tests: Sequence[StructureTest] = ()) -> Columns:
    """
    Compute the columns of all testable regressors.

    :param base: (M, N, K) columns of gravity.
    :param unknown: these and the structure tests are used with the final selection only.
    """
    builder = _Builder(motion, base)
    named = [Candidate(t.regressor, t.joint, t.setting, t.columns, t.shared, t.tried)
             for t in builder.added(effects)]
    untestable = dict(builder.untestable)
    others = builder.added(alternatives)
    core = list(builder.own_counts)
    bumps, tests = builder.added(unknown), builder.added(structure_tests)
    first = builder.n_shared
    layout = Layout(base.shape[2], _shifted(named, 0, first), _shifted(others, 0, first),
                    _shifted(bumps, 0, first), _shifted(tests, 0, first), untestable,
                    tuple(first + n for n in core))
    return Columns(layout, builder.shared, tuple(builder.own))


class _Builder:
    """
    Columns collected so far.

    A joint's own columns are numbered from 0 until the number of shared columns is final.
    """

    def __init__(self, motion: Motion, base: FloatArray) -> None:
        self.motion, self.scan = motion, _Scan(motion, base)
        self.shared, self.n_shared = [base], base.shape[2]
        self.own: list[list[FloatArray]] = [[] for _ in range(motion.samples.n_joints)]
        self.own_counts = [0] * motion.samples.n_joints
        self.untestable: dict[tuple[str, int | None], str] = {}

    def added(self, regressors: Sequence[R]) -> list[Trial[R]]:
        """Add the columns of regressors for every joint, and return their trials."""
        joints: Sequence[int | None] = range(self.motion.samples.n_joints)
        return [trial for regressor in regressors
                for joint in (joints if regressor.per_joint else [None])
                for trial in self._added(regressor, joint)]

    def _added(self, regressor: R, joint: int | None) -> list[Trial[R]]:
        number = joint or 0
        reason = regressor.untestable(self.motion, number)
        settings = [] if reason else regressor.settings(self.motion, number)
        if not settings:
            self.untestable[regressor.name, joint] = reason or 'this motion does not excite it'
            return []
        shared, trials = regressor.scope == 'arm', []
        for setting, columns in self.scan.best(regressor, number, settings):
            k = columns.shape[-1]
            at = self.n_shared if shared else self.own_counts[number]
            trials.append(Trial(regressor, joint, setting, np.arange(at, at + k), shared,
                                len(settings)))
            if shared:
                self.shared.append(columns)
                self.n_shared += k
            else:
                self.own[number].append(columns)
                self.own_counts[number] += k
        return trials


class _Scan:
    """Ranking of settings by the explained share of a coarse residual, on part of the samples."""

    def __init__(self, motion: Motion, base: FloatArray) -> None:
        self.motion = motion
        m, n = motion.samples.q.shape
        self.rows = np.arange(0, m, max(1, m // _SCAN_ROWS))
        self.part = motion.at(self.rows)
        self.bases, self.residual = [], []
        for joint in range(n):
            columns = np.column_stack([base[:, joint], nuisance(motion, joint)])[self.rows]
            basis, _ = np.linalg.qr(columns)
            y = self.part.samples.tau[:, joint]
            self.bases.append(basis)
            self.residual.append(y - basis @ (basis.T @ y))

    def best(self, regressor: Regressor, joint: int,
             settings: list[dict[str, float]]) -> list[tuple[Setting, FloatArray]]:
        """Return the settings with the largest gains, and their columns."""
        ranked = settings
        if len(settings) > _SETTINGS_KEPT:
            ranked = self._ranked(regressor, joint, settings)
            finer = [s for setting in ranked
                     for s in regressor.refine(self.motion, joint, setting)]
            if finer:
                ranked = self._ranked(regressor, joint, ranked + finer)
        return [(s, regressor.columns(self.motion, joint, s)) for s in ranked]

    def _ranked(self, regressor: Regressor, joint: int,
                settings: list[dict[str, float]]) -> list[dict[str, float]]:
        columns = [self._columns(regressor, joint, s) for s in settings]
        gains = np.zeros(len(settings))
        for n in range(self.motion.samples.n_joints):
            if regressor.scope == 'arm':
                gains += self._gains([part[:, n] for part in columns], n)
            elif n == joint:
                gains += self._gains(columns, n)
        order = np.argsort(-gains, kind='stable')[:_SETTINGS_KEPT]
        return [settings[k] for k in order]

    def _columns(self, regressor: Regressor, joint: int, setting: Setting) -> FloatArray:
        if regressor.pointwise:
            return regressor.columns(self.part, joint, setting)
        return regressor.columns(self.motion, joint, setting)[self.rows]

    def _gains(self, parts: list[FloatArray], n: int) -> FloatArray:
        """Return the share of a joint's residual that each set of columns (M, K) explains."""
        every = np.concatenate(parts, axis=1)
        # The residual is already orthogonal to gravity and nuisance terms.
        inside, c = self.bases[n].T @ every, every.T @ self.residual[n]
        noise = float(self.residual[n] @ self.residual[n]) or 1.0
        grams, at = [], 0
        for part in parts:
            along = inside[:, at:at + part.shape[1]]
            grams.append(part.T @ part - along.T @ along)
            at += part.shape[1]
        sizes = np.array([len(gram) for gram in grams])
        each = np.split(c, np.cumsum(sizes)[:-1])
        gains = np.zeros(len(parts))
        for size in np.unique(sizes):
            here = np.flatnonzero(sizes == size)
            gains[here] = _explained(np.stack([grams[k] for k in here]),
                                     np.stack([each[k] for k in here])) / noise
        return gains


def _explained(grams: FloatArray, c: FloatArray) -> FloatArray:
    """
    Return c' G^+ c (S,), the squared projection of a residual on each of S sets of K columns.

    :param grams: (S, K, K) products of the columns with each other.
    :param c: (S, K) products of the columns with the residual.
    """
    lengths = np.sqrt(np.maximum(np.diagonal(grams, axis1=1, axis2=2), 0.0))
    solid = lengths > 1e-9
    per_length = np.where(solid, 1.0 / np.where(solid, lengths, 1.0), 0.0)
    values, vectors = np.linalg.eigh(grams * per_length[:, :, None] * per_length[:, None])
    along = np.einsum('skl,sk->sl', vectors, c * per_length)
    kept = values > _RANK
    return np.asarray((along ** 2 * kept / np.where(kept, values, 1.0)).sum(axis=1))
