"""A base that tilts during a recording, so that the vertical changes once or a few times."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.arm_fit import ArmFit
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.models.kinematic.arm_solver import ArmState
import numpy as np


@dataclass(frozen=True)
class Tilt:
    """A tilt of the base by `angle` rad, from `begin` to `end` in s of the runs named `runs`."""

    angle: float
    begin: float
    end: float
    runs: tuple[str, str]

    def __str__(self) -> str:
        first, last = self.runs
        of_first, of_last = (f' of {run}' * (first != last) for run in self.runs)
        return (f'by {np.degrees(self.angle):.0f}° from {self.begin:.0f} s{of_first} to '
                f'{self.end:.0f} s{of_last}')


@dataclass(frozen=True)
class MovedBase:
    """
    The vertical of a recording.

    `white` are the residuals of a base that tilts, `evidence` in nats is that of such a base, less
    `tilt_gain` for each number of the tilts.
    """

    tilts: tuple[Tilt, ...]
    white: bool
    evidence: float

    def facts(self) -> list[Fact]:
        """Return the fact that the vertical changes, if it does."""
        tilts = [tilt for tilt in self.tilts if tilt.angle >= OPTIONS.min_tilt]
        if self.evidence < 0.0 or not self.white or not tilts:
            return []
        evidence = f'the vertical changes {" and ".join(map(str, tilts))}'
        if max(tilt.angle for tilt in tilts) < OPTIONS.linear_tilt:
            return [Fact(Kind.MOVED_BASE, (), evidence, Action.NOTED,
                         'the base tilted, as the effect base_tilt describes')]
        return [Fact(
            Kind.MOVED_BASE, (), evidence, Action.REFUSED, 'the base tilted, and a model has one '
            'vertical; learn from the parts before and after it separately',
            f'`gravity_comp cut` with --to and --from writes them; --accept '
            f'{Kind.MOVED_BASE} learns from all of it')]


def moved_base(fit: ArmFit) -> MovedBase | None:
    """Return the vertical of a recording, None where a base at rest explains it."""
    plain = fit.plain
    if fit.is_white(plain):
        return None
    state, ramps, evidence = plain, np.zeros((0, 2)), 0.0
    for _ in range(OPTIONS.max_tilts):
        before = evidence
        state, ramps = _one_more(fit, state, ramps)
        evidence = ((plain.cost - state.cost) / fit.time(state)
                    - 4.0 * OPTIONS.tilt_gain * len(ramps))
        # The first of two opposite tilts has no evidence of its own.
        if fit.is_white(state) or evidence < before and len(ramps) > 1:
            break
    t, runs, labels = fit.poses.t, fit.poses.runs, fit.poses.run_labels
    last = len(t) - 1
    tilts = []
    for tilt, (begin, end) in zip(state.base_tilts, ramps):
        rows = [int(np.clip(round(row), 0, last)) for row in (begin, end)]
        tilts.append(Tilt(float(np.linalg.norm(tilt)), float(t[rows[0]]), float(t[rows[1]]),
                          (labels[runs[rows[0]]], labels[runs[rows[1]]])))
    return MovedBase(tuple(sorted(tilts, key=lambda tilt: tilt.begin)),
                     fit.is_white(state), evidence)


def _one_more(fit: ArmFit, state: ArmState, ramps: FloatArray
              ) -> tuple[ArmState, FloatArray]:
    """Return the best fit with another tilt, and the rows (K, 2) where tilts begin and end."""
    rows, tilts = len(fit.q), np.vstack([state.base_tilts, np.zeros((1, 2))])
    # The longer part before or after the tilt has one vertical.
    halves = [fit.start(rows=slice(rows // 2)), fit.start(rows=slice(rows // 2, None))] \
        if not len(ramps) else [state.chain.axes] * 2
    width = rows / (OPTIONS.places + 1)
    best, at = None, ramps
    for place in width * np.arange(1, OPTIONS.places + 1):
        tried = np.vstack([ramps, [place, place]])
        near = fit.run(halves[int(place < rows / 2)], shares=_shares(tried, rows),
                       base_tilts=tilts)
        if best is None or near.cost < best.cost:
            best, at = near, tried
    assert best is not None
    if state.cost - best.cost < OPTIONS.tilt_gain * fit.time(best):
        return best, at
    while width > 1.0:
        width /= 2.0
        for begin, end in product((-width, 0.0, width), repeat=2):
            tried = at.copy()
            tried[-1] += begin, end
            if tried[-1, 0] > tried[-1, 1]:
                continue
            near = fit.run(best.chain.axes, shares=_shares(tried, rows),
                           base_tilts=best.base_tilts)
            if near.cost < best.cost:
                best, at = near, tried
    return best, at


def _shares(ramps: FloatArray, rows: int) -> FloatArray:
    """Return the shares (M, K) of tilts between rows (K, 2)."""
    begin, end = ramps.T
    return np.asarray(np.clip((np.arange(rows)[:, None] - begin)
                              / np.maximum(end - begin, 0.1), 0.0, 1.0))
