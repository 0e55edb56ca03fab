"""
The columns of every effect that this motion can show, next to those of the gravity model.

Shared columns come first: the energy's features, then effects that act on several joints. Each
joint then has its own effects. Effects with many settings (a frequency, a distance) are scanned
against what gravity, friction, offset and inertia leave of the torque, and only the best few
settings go on; the number tried is remembered, because the best of many is good by chance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.laws import StructureTest
from gravity_comp_ros.diagnosis.nonparametric import UnknownTorque
from gravity_comp_ros.diagnosis.nuisance import nuisance
from gravity_comp_ros.effects.effect import AlternativeModel, Effect, Regressor, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

_SETTINGS_KEPT = 3
# Directions of scaled columns below this are rounding.
_RANK = 1e-9
_SCAN_ROWS = 2500
R = TypeVar('R', bound=Regressor)
R_co = TypeVar('R_co', bound=Regressor, covariant=True)
T = TypeVar('T', bound='AnyTrial')


@dataclass(frozen=True, eq=False)
class Trial(Generic[R_co]):
    """
    One regressor with one setting: where its columns are.

    `joint` is the joint that it is about, None for the whole arm; `shared` says whether the
    columns are shared ones; `tried` how many settings the scan compared.
    """

    regressor: R_co
    joint: int | None
    setting: Setting
    columns: IntArray
    shared: bool
    tried: int

    @property
    def key(self) -> tuple[str, int | None]:
        """Return name and joint: settings of one effect exclude each other."""
        return self.regressor.name, self.joint

    @property
    def place(self) -> int:
        """Return the joint number that the regressor's methods are given."""
        return self.joint or 0

    @property
    def acts_on(self) -> int | None:
        """Return the joint on whose torque alone it acts, None if on several."""
        return None if self.shared else self.joint


AnyTrial = Trial[Regressor]


class Candidate(Trial[Effect]):
    """One effect with one setting, which a diagnosis may name."""

    @property
    def effect(self) -> Effect:
        return self.regressor

    @property
    def complexity(self) -> int:
        """Return how many numbers the effect spends: coefficients and scanned settings."""
        return len(self.columns) + self.effect.n_scanned(self.setting)

    def n_free(self, motion: Motion) -> int:
        """Return how many coefficients nothing is known of before any data."""
        usual = self.effect.spread(motion, self.place, self.setting)
        return len(self.columns) if usual is None else int(np.isinf(usual).sum())


@dataclass(frozen=True, eq=False)
class Layout:
    """
    Where columns are: those of gravity first, then shared ones, then those of each joint.

    `n_base` columns are of gravity; `untestable` says of an effect and a joint why this motion
    does not show it. `alternatives` to effects, `shapes` of unknown torque and `laws` have no
    name to find. Columns of a joint from number `n_core` (N,) on belong to tests that are made
    beside the final choice alone.
    """

    n_base: int
    candidates: tuple[Candidate, ...]
    alternatives: tuple[Trial[AlternativeModel], ...] = ()
    shapes: tuple[Trial[UnknownTorque], ...] = ()
    laws: tuple[Trial[StructureTest], ...] = ()
    untestable: Mapping[tuple[str, int | None], str] = field(default_factory=dict)
    n_core: tuple[int, ...] = ()

    def with_base(self, n_base: int) -> Layout:
        """Return where columns are beside another gravity of `n_base` columns."""
        shift = n_base - self.n_base
        return replace(self, n_base=n_base, n_core=tuple(n + shift for n in self.n_core),
                       candidates=_shifted(self.candidates, shift, shift),
                       alternatives=_shifted(self.alternatives, shift, shift),
                       shapes=_shifted(self.shapes, shift, shift),
                       laws=_shifted(self.laws, shift, shift))


def _shifted(trials: Sequence[T], shared: int, own: int) -> tuple[T, ...]:
    """Return trials with their columns moved, by so many if they are shared, or are not."""
    return tuple(replace(t, columns=t.columns + (shared if t.shared else own)) for t in trials)


@dataclass(frozen=True, eq=False)
class Columns:
    """All columns: `shared` (M, N, S), and `own`, for each joint a list of (M, K)."""

    layout: Layout
    shared: FloatArray
    own: tuple[list[FloatArray], ...]


def build(motion: Motion, base: FloatArray, effects: Sequence[Effect],
          alternatives: Sequence[AlternativeModel] = (), shapes: Sequence[UnknownTorque] = (),
          laws: Sequence[StructureTest] = ()) -> Columns:
    """
    Compute the columns of everything testable, beside those of gravity, (M, N, K).

    :param shapes: these and laws are tried beside the final choice alone.
    """
    builder = _Builder(motion, base)
    named = [Candidate(t.regressor, t.joint, t.setting, t.columns, t.shared, t.tried)
             for t in builder.added(effects)]
    untestable = dict(builder.untestable)
    others = builder.added(alternatives)
    core = list(builder.own_counts)
    unknown, broken = builder.added(shapes), builder.added(laws)
    first = builder.n_shared
    layout = Layout(base.shape[2], _shifted(named, 0, first), _shifted(others, 0, first),
                    _shifted(unknown, 0, first), _shifted(broken, 0, first), untestable,
                    tuple(first + n for n in core))
    return Columns(layout, np.concatenate(builder.shared, axis=2), tuple(builder.own))


class _Builder:
    """
    Columns so far, and what each belongs to.

    A joint's own columns are counted from its first one until all shared ones are known.
    """

    def __init__(self, motion: Motion, base: FloatArray) -> None:
        self.motion, self.scan = motion, _Scan(motion, base)
        self.shared, self.n_shared = [base], base.shape[2]
        self.own: list[list[FloatArray]] = [[] for _ in range(motion.samples.n_joints)]
        self.own_counts = [0] * motion.samples.n_joints
        self.untestable: dict[tuple[str, int | None], str] = {}

    def added(self, regressors: Sequence[R]) -> list[Trial[R]]:
        """Add the columns of regressors on every joint that each may act on."""
        joints: Sequence[int | None] = range(self.motion.samples.n_joints)
        return [trial for regressor in regressors
                for joint in (joints if regressor.per_joint else [None])
                for trial in self._added(regressor, joint)]

    def _added(self, regressor: R, joint: int | None) -> list[Trial[R]]:
        place = joint or 0
        reason = regressor.untestable(self.motion, place)
        settings = [] if reason else regressor.settings(self.motion, place)
        if not settings:
            self.untestable[regressor.name, joint] = reason or 'this motion does not reach it'
            return []
        shared, trials = regressor.scope == 'arm', []
        for setting, columns in self.scan.best(regressor, place, settings):
            k = columns.shape[-1]
            at = self.n_shared if shared else self.own_counts[place]
            trials.append(Trial(regressor, joint, setting, np.arange(at, at + k), shared,
                                len(settings)))
            if shared:
                self.shared.append(columns)
                self.n_shared += k
            else:
                self.own[place].append(columns)
                self.own_counts[place] += k
        return trials


class _Scan:
    """Ranks settings by what they explain of a coarse residual, on part of the samples."""

    def __init__(self, motion: Motion, base: FloatArray) -> None:
        self.motion = motion
        m, n = motion.samples.q.shape
        self.rows = np.arange(0, m, max(1, m // _SCAN_ROWS))
        self.part = motion.at(self.rows)
        self.known, self.residual = [], []
        for joint in range(n):
            columns = np.column_stack([base[:, joint], nuisance(motion, joint)])[self.rows]
            basis, _ = np.linalg.qr(columns)
            y = self.part.samples.tau[:, joint]
            self.known.append(basis)
            self.residual.append(y - basis @ (basis.T @ y))

    def best(self, regressor: Regressor, joint: int,
             settings: list[dict[str, float]]) -> list[tuple[Setting, FloatArray]]:
        """Return the most promising settings with their columns."""
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
        """Return the share of a joint's residual that each of the columns (M, K) explains."""
        every = np.concatenate(parts, axis=1)
        # The residual is orthogonal to the known columns already.
        inside, c = self.known[n].T @ every, every.T @ self.residual[n]
        noise = float(self.residual[n] @ self.residual[n]) or 1.0
        grams, at = [], 0
        for part in parts:
            known = inside[:, at:at + part.shape[1]]
            grams.append(part.T @ part - known.T @ known)
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
    Return c.T gram^+ c of each of S sets of K columns, (S,).

    That is the squared projection of a residual on columns with the products `grams` (S, K, K)
    with each other and `c` (S, K) with it.
    """
    lengths = np.sqrt(np.maximum(np.diagonal(grams, axis1=1, axis2=2), 0.0))
    solid = lengths > 1e-9
    per_length = np.where(solid, 1.0 / np.where(solid, lengths, 1.0), 0.0)
    values, vectors = np.linalg.eigh(grams * per_length[:, :, None] * per_length[:, None])
    along = np.einsum('skl,sk->sl', vectors, c * per_length)
    kept = values > _RANK
    return np.asarray((along ** 2 * kept / np.where(kept, values, 1.0)).sum(axis=1))
