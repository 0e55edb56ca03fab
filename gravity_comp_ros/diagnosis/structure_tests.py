"""
The laws that the gravity of a serial arm obeys, and whether a recording keeps them.

Gravity is the gradient of one energy, the same in all runs; no torque lacks the sine or cosine
of its own joint's angle, and on a level base none depends on the first. A law is tested with
columns that only its breach could use, on data that was not fitted. Which law breaks narrows
what is missing down before any effect has a name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.effect import (
    Coefficient, Columns, Effect, Motion, Setting, Untestable)
from gravity_comp_ros.evaluation.gain import Gain, gain
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

FAMILY = 'law'
_ALPHA = 0.01
# A breach that takes less than this off a joint's error changes no mind.
_LEAST_SHARE = 0.1
_MOVES = 0.05


@dataclass(frozen=True)
class StructureTest:
    """
    A law that a joint breaks, once the effects are counted that were named and do not break it.

    `holds_with_effects` says whether those that do break it, among them `suspects`, make up for
    it. `p` is the chance of the evidence against the law, `share` the part of the held-out
    error that its breach takes off.
    """

    law: str
    joint: str
    holds_with_effects: bool
    p: float
    share: float
    words: str
    suspects: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the report as `diagnose --json` prints it."""
        return {'law': self.law, 'joint': self.joint, 'holds': False,
                'holds_with_effects': self.holds_with_effects, 'p': self.p,
                'share': self.share, 'why': self.words, 'suspects': list(self.suspects)}


def check_laws(fits: Fits, chosen: Sequence[Candidate], laws: list[Candidate],
               names: tuple[str, ...]) -> tuple[StructureTest, ...]:
    """Return the laws that are broken, joint by joint."""
    broken = []
    for candidate in laws:
        joint, suspects = candidate.joint or 0, candidate.effect.confounders
        innocent = [c for c in chosen if c.effect.name not in suspects]
        reports = []
        for beside in (innocent, chosen):
            after, = fits.errors_with_each(joint, beside, [candidate])
            reports.append(gain(fits.errors(joint, beside), after, len(laws)))
        bare, named = reports
        if _is_kept(bare):
            continue
        effect = candidate.effect
        words = (f'{effect.description} on joint {names[joint]}: {bare.share:.0%} of the '
                 f'held-out error')
        broken.append(StructureTest(effect.name, names[joint], _is_kept(named), bare.p,
                                    bare.share, words, effect.confounders))
    return tuple(broken)


def _is_kept(evidence: Gain) -> bool:
    return bool(evidence.p >= _ALPHA or evidence.share < _LEAST_SHARE)


def _features(motion: Motion, joint: int) -> FloatArray:
    """Return the columns (M, K) that the energy's terms give a joint."""
    energy = motion.model.energy if motion.model is not None else None
    m, n = motion.samples.q.shape
    if energy is None or not energy.indices.size:
        return np.zeros((m, 0))
    columns = EnergyDesign(motion.samples.q, np.ones((m, n))).columns(energy.indices)
    mine = columns.reshape(n, m, -1)[joint]
    return np.asarray(mine[:, np.ptp(mine, axis=0) > 1e-9])


def _level(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    q, gravity = motion.samples.q[:, 0], motion.gravity[:, joint]
    return np.column_stack([np.sin(q), np.cos(q), gravity * np.sin(q), gravity * np.cos(q)])


def _not_level_to_see(motion: Motion, joint: int) -> str | None:
    return None if np.ptp(motion.samples.q[:, 0]) > _MOVES else 'the first joint hardly moves'


def _away(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    q = np.delete(motion.samples.q, joint, axis=1)
    q = q[:, np.ptp(q, axis=0) > _MOVES]
    return np.column_stack([np.sin(q), np.cos(q)])


def _alone(motion: Motion, joint: int) -> str | None:
    moving = np.delete(np.ptp(motion.samples.q, axis=0) > _MOVES, joint)
    return None if moving.any() else 'no other joint moves'


def _own_energy(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    return _features(motion, joint)


def _nothing_to_share(motion: Motion, joint: int) -> str | None:
    if motion.samples.n_joints < 2:
        return 'there is one joint only'
    return None if _features(motion, joint).shape[1] else 'gravity does not act on this joint'


def _by_run(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    runs = motion.samples.runs
    terms = np.column_stack([np.ones(len(runs)), _features(motion, joint)])
    return np.column_stack([terms * (runs == run)[:, None] for run in np.unique(runs)[1:]])


def _one_run(motion: Motion, joint: int) -> str | None:
    return None if len(np.unique(motion.samples.runs)) > 1 else 'there is one run only'


def _law(name: str, words: str, columns: Columns, untestable: Untestable,
         suspects: tuple[str, ...]) -> Effect:
    return Effect(
        name=name, title=words, family=FAMILY, equation='', description=words,
        coefficients=(Coefficient('a', 'N·m', 'size of the breach'),), columns=columns,
        confounders=suspects, experiment='', signature='position',
        source='gravity of a serial arm is the gradient of one energy',
        untestable=untestable)


LAWS = (
    _law('level base', 'torque that goes with the angle of the first joint', _level,
         _not_level_to_see, ('base_tilt', 'cable_stiffness', 'joint_spring')),
    _law('own joint', 'torque that goes with the angles of other joints alone', _away, _alone,
         ('tool_force', 'encoder_offset', 'cable_stiffness', 'coupled_friction')),
    _law('one energy', 'gravity of another size than the other joints tell', _own_energy,
         _nothing_to_share, ('torque_gain', 'tool_force', 'joint_flexibility')),
    _law('same in all runs', 'torque that changes from run to run', _by_run, _one_run,
         ('payload_change', 'base_tilt', 'encoder_offset', 'torque_drift', 'friction_drift')),
)
