"""Geometric errors: encoder offsets and base tilt."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import energy_terms as terms
from gravity_comp_ros.effects.change_points import (
    change_factor, change_points, finer_points, UNITS)
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion
import numpy as np

# Minimum gravity gradient, in N·m/rad, and minimum spread of gravity torque, in N·m.
_MIN_GRADIENT = 0.05
# Maximum gravity torque of a vertical first axis, relative to that of the second.
_VERTICAL = 0.3
# Maximum plausible tilt in rad.
_MAX_TILT = 0.35


class EncoderOffset(Effect):
    """
    Offset of a joint's zero angle, from before the recording or from a change point.

    Gravity estimated from the same recording absorbs a constant offset; an earlier gravity model
    does not.
    """

    name = 'encoder_offset'
    title = 'Encoder offset'
    family = 'geometry'
    equation = 'tau = delta dg(q)/dq_n throughout, or -delta dg(q)/dq_n before a time'
    description = ('Zero-angle error of a joint, for example after an encoder was replaced. It '
                   'changes the torque of all joints.')
    coefficients = (Coefficient('delta', 'rad', 'true angle minus reported angle'),)
    confounders = ('base_tilt', 'payload_change', 'joint_flexibility')
    experiment = 'move joint {joint} to its calibration mark and read its angle'
    signature = 'position'
    source = 'Yu 2022, Eq. (2), expanded to first order in one angle'
    scope = 'arm'
    setting_units = UNITS
    not_scanned = ('clock',)
    pointwise = True
    largest = 0.3
    why_not_larger = 'a linear model of the offset is inaccurate at this size; fit a new model'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        factor = change_factor(motion, setting)
        return (motion.gradient[:, :, joint] * factor[:, None])[:, :, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{'run': 1.0, 'time': 0.0}, *change_points(motion)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        return finer_points(motion, setting)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        slope = float(np.sqrt(np.mean(motion.gradient[:, :, joint] ** 2, axis=0)).max())
        if slope < _MIN_GRADIENT:
            return f'no gravity torque depends on the angle of this joint ({slope:.2g} N·m/rad)'
        return None


class BaseTilt(Effect):
    """
    The columns are the torque of all joints per angle of tilt, (M, N, 4).

    A base rotated by small angles adds U = g (alpha X + beta Y), X and Y the arm's first moment
    (sum of mass times position) along two horizontal directions. With a vertical first and a
    horizontal second axis, X = A cos q_1 - B sin q_1 and Y = A sin q_1 + B cos q_1, where A is
    in the plane perpendicular to axis 2 and B along that axis. The rotation q_2 lifts the arm by
    A, so g A = tau_2 + constant for every such arm. g B is the lateral component of
    `energy_terms.lateral` if the arm has a joint perpendicular to axis 2 (the third of a
    seven-axis arm), and constant to first order otherwise. Constants act on joint 1 alone. The
    azimuth of alpha and beta is that of axis 2 at q_1 = 0.
    """

    name = 'base_tilt'
    title = 'Base tilt'
    family = 'geometry'
    equation = ('tau = alpha d/dq (tau_2 cos q_1 ± B sin q_1) + beta d/dq (tau_2 sin q_1 ∓ B '
                'cos q_1) + moments on joint 1')
    description = ('Base that is not level. Gravity then acts on the first joint, which has no '
                   'gravity torque on a level base.')
    coefficients = (Coefficient('alpha', 'rad', 'tilt about axis 2 at q_1 = 0'),
                    Coefficient('beta', 'rad', 'tilt about the horizontal axis perpendicular to '
                                               'it'),
                    Coefficient('m_a', 'N·m', 'energy term cos q_1, independent of other joints'),
                    Coefficient('m_b', 'N·m', 'energy term sin q_1, independent of other joints'))
    confounders = ('encoder_offset', 'joint_spring', 'payload_change')
    experiment = ('check the base with a spirit level; move the first joint over its whole range '
                  'with the arm extended horizontally')
    signature = 'position of joint 1'
    source = ('R. Featherstone, Rigid Body Dynamics Algorithms, Springer, 2008 (gravity as an '
              'acceleration of the base); derived in effects/geometry.py')
    scope = 'arm'
    per_joint = False
    setting_units = {'side': ''}
    pointwise = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        key = f'tilt {setting["side"]:g}'
        if key not in motion.memo and motion.model is not None:
            energies = _tilt_energies(motion.model, setting['side'])
            motion.memo[key] = terms.torques(energies, motion.samples.q)
        return motion.memo[key]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return both signs of the lateral component, or 0 if there is none."""
        if motion.model is None or motion.samples.n_joints < 2:
            return []
        if _lateral(motion.model) is None:
            return [{'side': 0.0}]
        return [{'side': 1.0}, {'side': -1.0}]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.samples.n_joints < 2 or motion.model is None:
            return 'a base tilt requires a gravity model of at least two joints'
        first, second = (float(motion.gravity[:, n].std()) for n in (0, 1))
        if second < _MIN_GRADIENT or first > _VERTICAL * second:
            return 'the equation requires a vertical first axis and a horizontal second one'
        if float(np.ptp(motion.samples.q[:, 0])) < 0.2:
            return ('the first joint hardly moves, so that a tilt cannot be distinguished from '
                    'other masses')
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        tilt = float(np.hypot(values[0], values[1]))
        if tilt > _MAX_TILT:
            return f'a base tilt of {tilt:.2g} rad would be visible'
        return None


def _tilt_energies(model: GravityModel, side: float) -> list[Expansion]:
    """Return the energies per tilt about two horizontal axes, and of constant moments."""
    n = model.n_joints
    plane, one = _without_first(model.torques[1], n), Expansion(np.array([0]), np.array([1.0]))
    across = _lateral(model)
    first = [terms.times(plane, n, 0, dictionary.COS)]
    second = [terms.times(plane, n, 0, dictionary.SIN)]
    if across is not None and side:
        first.append(terms.times(_scaled(across, side), n, 0, dictionary.SIN))
        second.append(terms.times(_scaled(across, -side), n, 0, dictionary.COS))
    return [terms.total(first), terms.total(second),
            terms.times(one, n, 0, dictionary.COS), terms.times(one, n, 0, dictionary.SIN)]


def _lateral(model: GravityModel) -> Expansion | None:
    if model.energy is None:
        return None
    for turning in range(2, model.n_joints):
        part = terms.lateral(model.energy, model.n_joints, 1, turning)
        if part is not None:
            return _without_first(part, model.n_joints)
    return None


def _without_first(part: Expansion, n_joints: int) -> Expansion:
    """Return the terms that do not depend on q_1, as all do on a level base."""
    free = dictionary.digits(part.indices, n_joints)[:, 0] == dictionary.ONE
    return Expansion(part.indices[free], part.weights[free])


def _scaled(part: Expansion, factor: float) -> Expansion:
    return Expansion(part.indices, factor * part.weights)


EFFECTS = (EncoderOffset(), BaseTilt())
