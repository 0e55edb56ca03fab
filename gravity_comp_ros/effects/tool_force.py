"""
Forces that are fixed in the tool frame.

The torque of a force fixed in the tool frame on joint n depends on the joints after n only, not
on its own angle, unlike gravity. Such a force is not conservative.
"""

from __future__ import annotations

from itertools import product

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Needs, Setting)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.sparse import dictionary
import numpy as np

# Number of last joints with all features of a tool force; the joint before has two factors.
_EXACT_JOINTS = 3
# Minimum travel in rad of one of the last two joints for a tool force.
_MIN_TRAVEL = 0.1


class ToolForce(Effect):
    """One column for each feature, which acts on its joint alone, (M, N, K)."""

    name = 'tool_force'
    title = 'Force fixed in the tool frame'
    family = 'payload'
    equation = 'tau_n = sum_k f_nk phi_k(q_n+1 ... q_N)'
    description = ('Force that rotates with the tool, such as the pull of a hose. Unlike gravity, '
                   'its torque on a joint does not depend on the angle of that joint.')
    coefficients = (Coefficient('f_n[phi]', 'N·m', 'torque on joint n'),)
    confounders = ('torque_offset',)
    experiment = 'remove hoses and cables from the tool and record the same motion again'
    signature = 'position of the last joints'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('R. Featherstone, Rigid Body Dynamics Algorithms, Springer, 2008 (J^T f); derived '
              'in effects/tool_force.py')
    scope = 'arm'
    per_joint = False
    is_static = True
    resembles_gravity = True
    size = 0.03

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q = motion.samples.q
        pairs = _tool_features(q.shape[1])
        values = dictionary.columns(q, np.array([feature for _, feature in pairs]))
        out = np.zeros((*q.shape, len(pairs)))
        for k, (place, _) in enumerate(pairs):
            out[:, place, k] = values[:, k]
        return out

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        n = motion.samples.n_joints
        return tuple(Coefficient(f'f_{place + 1}[{dictionary.feature_name(feature, n)}]', 'N·m',
                                 f'torque on joint number {place + 1}')
                     for place, feature in _tool_features(n))

    def untestable(self, motion: Motion, joint: int) -> str | None:
        n = motion.samples.n_joints
        if n < 2:
            return 'with one joint a tool force cannot be distinguished from an offset'
        if excitation.travel(motion, n - 1) < _MIN_TRAVEL and (
                n < 3 or excitation.travel(motion, n - 2) < _MIN_TRAVEL):
            return ('the last joints hardly move, so that a tool force cannot be distinguished '
                    'from offsets')
        return None


def _tool_features(n_joints: int) -> list[tuple[int, int]]:
    """
    Return (joint, feature) pairs of a tool force.

    Features of the joints after `joint`: all for the last three joints, those with at most two
    factors for the one before. Earlier joints would require hundreds of features or kinematics
    and are not modelled.
    """
    pairs = []
    for joint in range(max(0, n_joints - _EXACT_JOINTS - 1), n_joints):
        max_factors = n_joints if joint >= n_joints - _EXACT_JOINTS else 2
        after = n_joints - 1 - joint
        for tail in product(range(3), repeat=after):
            if sum(factor != dictionary.ONE for factor in tail) <= max_factors:
                factors = np.array([[dictionary.ONE] * (joint + 1) + list(tail)])
                pairs.append((joint, int(dictionary.index_of(factors)[0])))
    return pairs


EFFECTS = (ToolForce(),)
