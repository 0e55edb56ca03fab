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

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.nuisance import nuisance
from gravity_comp_ros.effects.effect import Effect, Motion, Setting
import numpy as np

_SETTINGS_KEPT = 3
# What a moving joint usually has.
USUAL = ('coulomb_friction', 'viscous_friction', 'torque_offset')
# What an arm has because it moves, what a joint may well have, and all the rest: each has the
# same part of the chance of a false alarm.
MOTION, COMMON, RARE = 'motion', 'common', 'rare'
_DYNAMICS = 'dynamics'
# Directions of scaled columns below this are rounding.
_RANK = 1e-9
_SCAN_ROWS = 2500


def expectation(effect: Effect) -> str:
    """Return whether an effect comes with motion, is common in joints, or is rare."""
    if effect.family == _DYNAMICS:
        return MOTION
    return COMMON if effect.name in (*USUAL, 'joint_spring') else RARE


@dataclass(frozen=True)
class Candidate:
    """
    One effect with one setting: where its columns are.

    `joint` is the joint that the effect is about, None for the whole arm; `shared` says whether
    the columns are shared ones; `tried` how many settings the scan compared.
    """

    effect: Effect
    joint: int | None
    setting: Setting
    columns: IntArray
    shared: bool
    tried: int

    @property
    def key(self) -> tuple[str, int | None]:
        """Return effect name and joint: settings of one effect exclude each other."""
        return self.effect.name, self.joint

    @property
    def expectation(self) -> str:
        """Return `MOTION`, `COMMON` or `RARE`."""
        return expectation(self.effect)

    @property
    def complexity(self) -> int:
        """Return how many numbers the effect spends: coefficients and scanned settings."""
        return len(self.columns) + self.effect.n_scanned(self.setting)


@dataclass(frozen=True, eq=False)
class Layout:
    """
    Where columns are: those of gravity first, then shared ones, then those of each joint.

    `n_base` columns are of gravity; `untestable` says of an effect and a joint why this motion
    does not show it. Columns of a joint from number `n_core` (N,) on belong to tests that are
    made beside the final choice alone.
    """

    n_base: int
    candidates: tuple[Candidate, ...]
    untestable: Mapping[tuple[str, int | None], str] = field(default_factory=dict)
    n_core: tuple[int, ...] = ()

    def of_family(self, family: str) -> list[Candidate]:
        """Return the candidates of one family of effects."""
        return [c for c in self.candidates if c.effect.family == family]

    def with_base(self, n_base: int) -> Layout:
        """Return where columns are beside another gravity of `n_base` columns."""
        shift = n_base - self.n_base
        return replace(self, n_base=n_base, n_core=tuple(n + shift for n in self.n_core),
                       candidates=tuple(replace(c, columns=c.columns + shift)
                                        for c in self.candidates))


@dataclass(frozen=True, eq=False)
class Columns:
    """All columns: `shared` (M, N, S), and `own`, for each joint a list of (M, K)."""

    layout: Layout
    shared: FloatArray
    own: tuple[list[FloatArray], ...]


def build(motion: Motion, base: FloatArray, effects: Sequence[Effect],
          tests: Sequence[Effect] = ()) -> Columns:
    """
    Compute the columns of every testable effect, beside those of gravity, (M, N, K).

    :param tests: what is tried beside the final choice alone.
    """
    builder = _Builder(motion, base)
    for effect in effects:
        builder.add(effect)
    core = list(builder.own_counts)
    for effect in tests:
        builder.add(effect)
    counts = builder.n_shared
    candidates = tuple(
        Candidate(p.effect, p.joint, p.setting,
                  np.arange(p.at, p.at + p.count) + (0 if p.effect.scope == 'arm' else counts),
                  p.effect.scope == 'arm', p.tried) for p in builder.placed)
    layout = Layout(base.shape[2], candidates, builder.untestable,
                    tuple(counts + n for n in core))
    return Columns(layout, np.concatenate(builder.shared, axis=2), tuple(builder.own))


@dataclass(frozen=True)
class _Placed:
    """An effect with a setting, whose `count` columns begin at `at`."""

    effect: Effect
    joint: int | None
    setting: Setting
    at: int
    count: int
    tried: int


class _Builder:
    """Columns so far, and which effect each belongs to."""

    def __init__(self, motion: Motion, base: FloatArray) -> None:
        self.motion, self.scan = motion, _Scan(motion, base)
        self.shared, self.n_shared = [base], base.shape[2]
        self.own: list[list[FloatArray]] = [[] for _ in range(motion.samples.n_joints)]
        self.own_counts = [0] * motion.samples.n_joints
        self.placed: list[_Placed] = []
        self.untestable: dict[tuple[str, int | None], str] = {}

    def add(self, effect: Effect) -> None:
        """Add the columns of an effect on every joint that it may act on."""
        for joint in _joints(effect, self.motion):
            place = joint or 0
            reason = effect.untestable(self.motion, place)
            settings = [] if reason else effect.settings(self.motion, place)
            if not settings:
                self.untestable[effect.name, joint] = reason or 'this motion does not reach it'
                continue
            for setting, columns in self.scan.best(effect, place, settings):
                k = columns.shape[-1]
                at = self.n_shared if effect.scope == 'arm' else self.own_counts[place]
                self.placed.append(_Placed(effect, joint, setting, at, k, len(settings)))
                if effect.scope == 'arm':
                    self.shared.append(columns)
                    self.n_shared += k
                else:
                    self.own[place].append(columns)
                    self.own_counts[place] += k


def _joints(effect: Effect, motion: Motion) -> list[int | None]:
    whole_arm = effect.scope == 'arm' and not effect.per_joint
    return [None] if whole_arm else list(range(motion.samples.n_joints))


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

    def best(self, effect: Effect, joint: int,
             settings: list[dict[str, float]]) -> list[tuple[Setting, FloatArray]]:
        """Return the most promising settings with their columns."""
        ranked = settings
        if len(settings) > _SETTINGS_KEPT:
            ranked = self._ranked(effect, joint, settings)
            finer = [s for setting in ranked for s in effect.refine(self.motion, joint, setting)]
            if finer:
                ranked = self._ranked(effect, joint, ranked + finer)
        return [(s, effect.columns(self.motion, joint, s)) for s in ranked]

    def _ranked(self, effect: Effect, joint: int,
                settings: list[dict[str, float]]) -> list[dict[str, float]]:
        columns = [self._columns(effect, joint, s) for s in settings]
        gains = np.zeros(len(settings))
        for n in range(self.motion.samples.n_joints):
            if effect.scope == 'arm':
                gains += self._gains([part[:, n] for part in columns], n)
            elif n == joint:
                gains += self._gains(columns, n)
        order = np.argsort(-gains, kind='stable')[:_SETTINGS_KEPT]
        return [settings[k] for k in order]

    def _columns(self, effect: Effect, joint: int, setting: Setting) -> FloatArray:
        if effect.pointwise:
            return effect.columns(self.part, joint, setting)
        return effect.columns(self.motion, joint, setting)[self.rows]

    def _gains(self, parts: list[FloatArray], n: int) -> FloatArray:
        """Return the share of a joint's residual that each of the columns (M, K) explains."""
        every = np.concatenate(parts, axis=1)
        # The residual is orthogonal to the known columns already.
        inside, c = self.known[n].T @ every, every.T @ self.residual[n]
        noise = float(self.residual[n] @ self.residual[n]) or 1.0
        gains, at = np.zeros(len(parts)), 0
        for place, part in enumerate(parts):
            here = slice(at, at + part.shape[1])
            gram = part.T @ part - inside[:, here].T @ inside[:, here]
            gains[place] = _explained(gram, c[here]) / noise
            at += part.shape[1]
        return gains


def _explained(gram: FloatArray, c: FloatArray) -> float:
    """Return c.T gram^+ c: the squared projection of a residual on columns of these products."""
    lengths = np.sqrt(np.maximum(np.diag(gram), 0.0))
    solid = lengths > 1e-9
    if solid.sum() < 2:
        return float(((c[solid] / lengths[solid]) ** 2).sum())
    unit = gram[np.ix_(solid, solid)] / np.outer(lengths[solid], lengths[solid])
    values, vectors = np.linalg.eigh(unit)
    kept = values > _RANK
    return float(((vectors[:, kept].T @ (c[solid] / lengths[solid])) ** 2 / values[kept]).sum())
