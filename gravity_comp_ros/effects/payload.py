"""
Effects of the tool: payload changes, and forces fixed in the tool frame.

A mass at the tool adds to every first moment h_i of the chain. Without the lengths of the links
the changes of the moments are free, with a prior of the size of the moments.
The torque of a force fixed in the tool frame on joint n depends on the joints after n only, not
on its own angle, unlike gravity. Such a force is not conservative.
"""

from __future__ import annotations

from itertools import product

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.changes import change_factor, ChangeEffect
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Needs, Setting)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.sparse import dictionary
import numpy as np

# Number of last joints with all features of a tool force; the joint before has two factors.
_EXACT_JOINTS = 3
# Minimum travel in rad of one of the last two joints for a tool force.
_MIN_TRAVEL = 0.1


class PayloadChange(ChangeEffect):
    """The columns are the torque of each moment of the chain, negative before the change."""

    name = 'payload_change'
    title = 'Payload change during the recording'
    family = 'payload'
    equation = ('tau = -sum_i (m_i d/dh_ix + n_i d/dh_iy) tau_g before the change, h_i the first '
                'moment about joint i')
    description = 'Tool or load that is attached or removed during the recording.'
    coefficients = (Coefficient('m_i', 'N·m', 'change of the first moment about joint number i, '
                                              'in its first direction'),
                    Coefficient('n_i', 'N·m', 'the same in its second direction'))
    confounders = ('torque_gain', 'torque_drift', 'encoder_offset', 'base_tilt')
    experiment = ('record one run with the load and one without it, and estimate the change with '
                  '`gravity_comp update`')
    signature = 'time'
    source = 'Yu 2022 (updates after a change of payload); derived in effects/payload.py'
    scope = 'arm'
    per_joint = False
    shares = (0.5,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        assert motion.chain is not None
        key = 'moments'
        if key not in motion.of_gravity:
            kinematics = ForwardKinematics(motion.chain.axes, motion.samples.q)
            motion.of_gravity[key] = kinematics.moment_columns().transpose(2, 1, 0)
        return motion.of_gravity[key] * change_factor(motion, setting)[:, None, None]

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        return tuple(Coefficient(f'{symbol}_{n + 1}', 'N·m',
                                 f'change of the first moment about joint number {n + 1}')
                     for n in range(motion.samples.n_joints) for symbol in ('m', 'n'))

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.chain is None:
            return 'a payload change requires a serial arm as the model of gravity'
        return super().untestable(motion, joint)


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
              'in effects/payload.py')
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


EFFECTS = (PayloadChange(), ToolForce())
