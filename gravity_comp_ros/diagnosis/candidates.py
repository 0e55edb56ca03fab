"""
The columns of every effect that this motion can show, next to those of the gravity model.

Shared columns come first: the energy's features, then effects that act on several joints. Each
joint then has its own effects. Effects with many settings (a frequency, a distance) are scanned
against what gravity, friction, offset and inertia leave of the torque, and only the best few
settings go on; the number tried is remembered, because the best of many is good by chance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.nuisance import nuisance
from gravity_comp_ros.effects.effect import Effect, Motion, Setting
import numpy as np

_SETTINGS_KEPT = 3
# What everybody expects in a joint.
_COMMON = ('coulomb_friction', 'viscous_friction', 'torque_offset', 'joint_spring')
# What an arm has because it moves, what a joint may well have, and all the rest: each has the
# same part of the chance of a false alarm.
MOTION, COMMON, RARE = 'motion', 'common', 'rare'
_DYNAMICS = 'dynamics'
# Directions of scaled columns below this are rounding.
_RANK = 1e-9
_SCAN_ROWS = 4000


def expectation(effect: Effect) -> str:
    """Return whether an effect comes with motion, is common in joints, or is rare."""
    if effect.family == _DYNAMICS:
        return MOTION
    return COMMON if effect.name in _COMMON else RARE


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


@dataclass
class Columns:
    """All columns: `shared` (M, N, S), `own` one (M, P_n) per joint, and the candidates."""

    n_base: int
    shared: FloatArray
    own: list[FloatArray]
    candidates: list[Candidate]
    untestable: dict[tuple[str, int | None], str] = field(default_factory=dict)

    def of_joint(self, joint: int) -> FloatArray:
        """Return a joint's columns: the shared ones, then its own."""
        return np.column_stack([self.shared[:, joint], self.own[joint]])

    def of_family(self, family: str) -> list[Candidate]:
        """Return the candidates of one family of effects."""
        return [c for c in self.candidates if c.effect.family == family]

    def with_base(self, base: FloatArray) -> Columns:
        """Return these columns beside another gravity, base (M, N, K)."""
        shift = base.shape[2] - self.n_base
        shared = np.concatenate([base, self.shared[:, :, self.n_base:]], axis=2)
        moved = [replace(c, columns=c.columns + shift) for c in self.candidates]
        return Columns(base.shape[2], shared, self.own, moved, self.untestable)


def build(motion: Motion, base: FloatArray, effects: Mapping[str, Effect]) -> Columns:
    """Compute the columns of every testable effect, beside those of gravity, (M, N, K)."""
    scan = _Scan(motion, base)
    untestable: dict[tuple[str, int | None], str] = {}
    shared = [base]
    own: list[list[FloatArray]] = [[] for _ in range(motion.samples.n_joints)]
    counts, own_counts = base.shape[2], [0] * motion.samples.n_joints
    found: list[tuple[Effect, int | None, Setting, int, int, bool, int]] = []
    for effect in effects.values():
        for joint in _joints(effect, motion):
            place = joint or 0
            reason = effect.untestable(motion, place)
            settings = [] if reason else effect.settings(motion, place)
            if not settings:
                untestable[effect.name, joint] = reason or 'this motion does not reach it'
                continue
            for setting, columns in scan.best(effect, place, settings):
                k = columns.shape[-1]
                if effect.scope == 'arm':
                    shared.append(columns)
                    found.append((effect, joint, setting, counts, k, True, len(settings)))
                    counts += k
                else:
                    own[place].append(columns)
                    found.append((effect, joint, setting, own_counts[place], k, False,
                                  len(settings)))
                    own_counts[place] += k
    candidates = [Candidate(e, j, s, np.arange(at, at + k) + (0 if is_shared else counts),
                            is_shared, tried) for e, j, s, at, k, is_shared, tried in found]
    m = motion.samples.n_samples
    stacked = [np.column_stack(parts) if parts else np.zeros((m, 0)) for parts in own]
    return Columns(base.shape[2], np.concatenate(shared, axis=2), stacked, candidates,
                   untestable)


def _joints(effect: Effect, motion: Motion) -> list[int | None]:
    whole_arm = effect.scope == 'arm' and not effect.per_joint
    return [None] if whole_arm else list(range(motion.samples.n_joints))


class _Scan:
    """Ranks settings by what they explain of a coarse residual, on part of the samples."""

    def __init__(self, motion: Motion, base: FloatArray) -> None:
        self.motion = motion
        m, n = motion.samples.q.shape
        self.rows = np.arange(0, m, max(1, m // _SCAN_ROWS))
        self.nuisance, self.residual = [], []
        for joint in range(n):
            known = np.column_stack([base[:, joint], nuisance(motion, joint)])[self.rows]
            basis, _ = np.linalg.qr(known)
            y = motion.samples.tau[self.rows, joint]
            self.nuisance.append(basis)
            self.residual.append(y - basis @ (basis.T @ y))

    def best(self, effect: Effect, joint: int,
             settings: list[dict[str, float]]) -> list[tuple[Setting, FloatArray]]:
        """Return the most promising settings with their columns."""
        if len(settings) <= _SETTINGS_KEPT:
            return [(s, effect.columns(self.motion, joint, s)) for s in settings]
        ranked = self._ranked(effect, joint, settings)
        finer = [s for setting in ranked for s in effect.refine(self.motion, joint, setting)]
        if finer:
            ranked = self._ranked(effect, joint, ranked + finer)
        return [(s, effect.columns(self.motion, joint, s)) for s in ranked]

    def _ranked(self, effect: Effect, joint: int,
                settings: list[dict[str, float]]) -> list[dict[str, float]]:
        gains = [self._gain(effect.columns(self.motion, joint, s), joint) for s in settings]
        order = np.argsort(-np.array(gains), kind='stable')[:_SETTINGS_KEPT]
        return [settings[k] for k in order]

    def _gain(self, columns: FloatArray, joint: int) -> float:
        joints = range(columns.shape[1]) if columns.ndim == 3 else [joint]
        total = 0.0
        for n in joints:
            part = (columns[:, n] if columns.ndim == 3 else columns)[self.rows]
            # The residual is orthogonal to the nuisance terms already.
            inside, c = self.nuisance[n].T @ part, part.T @ self.residual[n]
            gram = part.T @ part - inside.T @ inside
            noise = float(self.residual[n] @ self.residual[n]) or 1.0
            total += _explained(gram, c) / noise
        return total


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
