"""
Structural laws of a serial arm's gravity, each with columns that the law excludes.

Gravity is the gradient of one energy, the same in all runs. Every term of a joint's torque has the
sine or cosine of its own angle. On a level base no torque depends on the first joint.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Regressor, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.sparse.dictionary import derivative, Halves
import numpy as np

# Minimum travel, in rad, of a joint that counts as moving.
_MIN_TRAVEL = 0.05
# Maximum number of gravity terms of a joint in a test; the largest are used.
_MAX_TERMS = 60


class StructureTest(Regressor):
    """
    A law of gravity, with the columns that it excludes.

    `violation` describes a torque that violates it, `suspects` are effects with such a torque.
    """

    violation: str
    suspects: tuple[str, ...]


def _features(motion: Motion, joint: int) -> FloatArray:
    """Return the columns (M, K) of the energy's largest terms for a joint."""
    key = f'features {joint}'
    if key not in motion.memo:
        motion.memo[key] = _largest_terms(motion, joint)
    return motion.memo[key]


def _largest_terms(motion: Motion, joint: int) -> FloatArray:
    energy, q = motion.model.energy if motion.model is not None else None, motion.samples.q
    if energy is None or not energy.indices.size:
        return np.zeros((len(q), 0))
    terms, signs = derivative(energy.indices, q.shape[1], joint)
    present = np.flatnonzero(signs)
    columns = Halves(q).columns(terms[present]) * signs[present, None]
    acting = np.flatnonzero(np.ptp(columns, axis=1) > 1e-9)
    size = np.abs(energy.weights[present[acting]]) * columns[acting].std(axis=1)
    largest = np.sort(acting[np.argsort(-size, kind='stable')[:_MAX_TERMS]])
    return np.ascontiguousarray(columns[largest].T)


class LevelBase(StructureTest):
    name = 'level base'
    violation = 'torque that depends on the angle of the first joint'
    suspects = ('base_tilt', 'cable_stiffness', 'joint_spring')

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q, gravity = motion.samples.q[:, 0], motion.gravity[:, joint]
        return np.column_stack([np.sin(q), np.cos(q), gravity * np.sin(q), gravity * np.cos(q)])

    def untestable(self, motion: Motion, joint: int) -> str | None:
        moves = np.ptp(motion.samples.q[:, 0]) > _MIN_TRAVEL
        return None if moves else 'the first joint hardly moves'


class OwnJoint(StructureTest):
    name = 'own joint'
    violation = 'torque that depends on the angles of other joints only'
    suspects = ('tool_force', 'encoder_offset', 'cable_stiffness', 'coupled_friction')

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q = np.delete(motion.samples.q, joint, axis=1)
        q = q[:, np.ptp(q, axis=0) > _MIN_TRAVEL]
        return np.column_stack([np.sin(q), np.cos(q)])

    def untestable(self, motion: Motion, joint: int) -> str | None:
        moving = np.delete(np.ptp(motion.samples.q, axis=0) > _MIN_TRAVEL, joint)
        return None if moving.any() else 'no other joint moves'


class OneEnergy(StructureTest):
    name = 'one energy'
    violation = 'gravity torque inconsistent with the energy of the other joints'
    suspects = ('torque_gain', 'tool_force', 'joint_flexibility')

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return _features(motion, joint)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.samples.n_joints < 2:
            return 'there is one joint only'
        return None if _features(motion, joint).shape[1] else 'gravity does not act on this joint'


class SameInAllRuns(StructureTest):
    name = 'same in all runs'
    violation = 'torque that changes from run to run'
    suspects = ('payload_change', 'base_tilt', 'encoder_offset', 'torque_drift',
                'friction_drift')

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        runs = motion.samples.runs
        terms = np.column_stack([np.ones(len(runs)), _features(motion, joint)])
        return np.column_stack([terms * (runs == run)[:, None] for run in np.unique(runs)[1:]])

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return None if len(np.unique(motion.samples.runs)) > 1 else 'there is one run only'


STRUCTURE_TESTS = (LevelBase(), OwnJoint(), OneEnergy(), SameInAllRuns())
