"""An arm that does not stand, or count its angles, as the model says."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import energy_terms as terms
from gravity_comp_ros.effects.change_points import change, change_points, finer_points, UNITS
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion
import numpy as np

_LEAST_SLOPE = 0.05
# The first axis counts as vertical if gravity turns it this much less than the second.
_UPRIGHT = 0.3
_STEEPEST = 0.35


class EncoderOffset(Effect):
    """
    A joint's zero may have moved before the recording, or on the way.

    An offset that was there throughout belongs to the gravity that is learned from the same
    recording; it shows beside a model that was learned before.
    """

    name = 'encoder_offset'
    title = 'Encoder offset'
    family = 'geometry'
    equation = 'tau = delta dg(q)/dq_n throughout, or -delta dg(q)/dq_n before a time'
    description = ('A joint whose zero is not where the model has it, as after the change of an '
                   'encoder; all joints carry another torque.')
    coefficients = (Coefficient('delta', 'rad', 'true angle less the one that is reported'),)
    confounders = ('base_tilt', 'payload_change', 'joint_flexibility')
    experiment = 'drive joint {joint} to its calibration mark and read its angle'
    signature = 'position'
    source = 'Yu 2022, Eq. (2), expanded to first order in one angle'
    scope = 'arm'
    setting_units = UNITS
    not_scanned = ('clock',)
    pointwise = True
    largest = 0.3
    why_not_larger = 'an offset that large is another zero; fit a new model'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return (motion.gradient[:, :, joint] * change(motion, setting)[:, None])[:, :, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{'run': 1.0, 'time': 0.0}, *change_points(motion)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        return finer_points(motion, setting)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        slope = float(np.sqrt(np.mean(motion.gradient[:, :, joint] ** 2, axis=0)).max())
        if slope < _LEAST_SLOPE:
            return f'no gravity torque depends on the angle of this joint ({slope:.2g} N·m/rad)'
        return None


class BaseTilt(Effect):
    """
    The columns are the torque of all joints per angle of tilt, (M, N, 4).

    A base turned by small angles adds U = g (alpha X + beta Y), X and Y the arm's first moment
    (sum of mass times position) along two horizontal directions. With a vertical first and a
    horizontal second axis, X = A cos q_1 - B sin q_1 and Y = A sin q_1 + B cos q_1, where A lies
    in the plane across axis 2 and B along that axis. Turning q_2 lifts the arm by A, so
    g A = tau_2 + constant, which holds for every arm of that kind; g B is the lateral component
    of `energy_terms.lateral`, if the arm has a joint that turns across axis 2 (a seven-axis
    arm's third), and constant to first order otherwise. Constants act on joint 1 alone. The
    azimuth in which alpha and beta are counted is that of axis 2 at q_1 = 0.
    """

    name = 'base_tilt'
    title = 'Tilted base'
    family = 'geometry'
    equation = ('tau = alpha d/dq (tau_2 cos q_1 ± B sin q_1) + beta d/dq (tau_2 sin q_1 ∓ B '
                'cos q_1) + moments on joint 1')
    description = ('A base that leans: gravity then turns the first axis, which a level base '
                   'never lets it.')
    coefficients = (Coefficient('alpha', 'rad', 'tilt about axis 2 at q_1 = 0'),
                    Coefficient('beta', 'rad', 'tilt across it'),
                    Coefficient('m_a', 'N·m', 'part of it that is constant in q_2 and beyond'),
                    Coefficient('m_b', 'N·m', 'the same across it'))
    confounders = ('encoder_offset', 'joint_spring', 'payload_change')
    experiment = ('put a spirit level on the base; turn the first joint through its whole range '
                  'with the arm stretched out level')
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
        """Return both senses in which the lateral component may point, or 0 without one."""
        if motion.model is None or motion.samples.n_joints < 2:
            return []
        if _lateral(motion.model) is None:
            return [{'side': 0.0}]
        return [{'side': 1.0}, {'side': -1.0}]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.samples.n_joints < 2 or motion.model is None:
            return 'a tilted base is told from a gravity model of at least two joints'
        first, second = (float(motion.gravity[:, n].std()) for n in (0, 1))
        if second < _LEAST_SLOPE or first > _UPRIGHT * second:
            return ('the first axis is not vertical with a horizontal one after it, so a tilt '
                    'looks like no one thing')
        if float(np.ptp(motion.samples.q[:, 0])) < 0.2:
            return 'the first joint hardly moves, so a tilt looks like other masses'
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        tilt = float(np.hypot(values[0], values[1]))
        if tilt > _STEEPEST:
            return f'a base that leans by {tilt:.2g} rad would be seen'
        return None


def _tilt_energies(model: GravityModel, side: float) -> list[Expansion]:
    """Return energy per tilt about two horizontal axes, and of two constant first moments."""
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
        found = terms.lateral(model.energy, model.n_joints, 1, turning)
        if found is not None:
            return _without_first(found, model.n_joints)
    return None


def _without_first(part: Expansion, n_joints: int) -> Expansion:
    """Return the terms without q_1, which a level base has none of."""
    free = dictionary.digits(part.indices, n_joints)[:, 0] == dictionary.ONE
    return Expansion(part.indices[free], part.weights[free])


def _scaled(part: Expansion, factor: float) -> Expansion:
    return Expansion(part.indices, factor * part.weights)


EFFECTS = (EncoderOffset(), BaseTilt())
