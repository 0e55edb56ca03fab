"""
Effects of the tool: payload changes, and forces fixed in the tool frame.

Neither requires kinematics. A mass at the tool adds to every first moment h_i of the chain, mostly
parallel to it, so that each part of the energy, by the last joint of its features, is scaled by a
factor. A payload off the last joint axis adds features of that joint; their direction of gravity
consists of other components of the previous one (`energy_terms`).
The torque of a force fixed in the tool frame on joint n depends on the joints after n only, not
on its own angle, unlike gravity. Such a force is not conservative.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from gravity_comp_ros.data.runs import recorded_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import energy_terms as terms, excitation
from gravity_comp_ros.effects.change_points import (
    change_factor, change_points, finer_points, UNITS)
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Setting, too_much_torque)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion
import numpy as np

# Minimum duration of motion before and after a payload change, in s.
_MIN_DURATION = 10.0
# Accuracy in s of a duration computed from a share of the samples.
_ROUNDING = 0.1
# Number of last joints with all features of a tool force; the joint before has two factors.
_EXACT_JOINTS = 3
# Minimum travel in rad of one of the last two joints for a tool force.
_MIN_TRAVEL = 0.1
# Maximum sum of the absolute terms of a tool force, relative to its largest plausible torque.
_CANCELLATION = 3.0
# Minimum relative change of a moment further out than the largest change; not checked for the
# last joints, since links of a wrist may have no length.
_MIN_OUTER, _WRIST = 0.5, 2
# Minimum torque change of a part of the energy, relative to the largest, for it to be checked.
_MIN_TORQUE = 0.02


def _share(name: str) -> Coefficient:
    kind, _, place = name.partition('_')
    if kind == 'm':
        return Coefficient(name, '', f'change of the first moment about joint number {place}, '
                                     'relative to its value after the change')
    return Coefficient(name, '', 'first moment perpendicular to the last axis, relative to that '
                                 'of the joint before it')


class PayloadChange(Effect):
    """The columns are the torque of each energy, negative before the change and 0 after it."""

    name = 'payload_change'
    title = 'Payload change during the recording'
    family = 'payload'
    equation = ('tau = -sum_i m_i dU_i(q)/dq before the change, U_i the terms of the energy with '
                'last joint i')
    description = ('Tool or load that is attached or removed during the recording. The gravity '
                   'model is that of the end of the recording, so that later recordings are '
                   'predicted with the last payload.')
    coefficients = (_share('m_i'), _share('e_s'))
    confounders = ('torque_gain', 'torque_drift', 'encoder_offset', 'base_tilt')
    experiment = ('record one run with the load and one without it, and estimate the change with '
                  '`gravity_comp update`')
    signature = 'time'
    source = 'Yu 2022 (updates after a change of payload); derived in effects/payload.py'
    scope = 'arm'
    per_joint = False
    setting_units = UNITS
    not_scanned = ('clock',)
    pointwise = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        if 'payload' not in motion.memo and motion.model is not None:
            energies = [energy for _, energy in _payload_energies(motion.model)]
            motion.memo['payload'] = terms.torques(energies, motion.samples.q)
        return motion.memo['payload'] * change_factor(motion, setting)[:, None, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        if motion.model is None or not _payload_energies(motion.model):
            return []
        return _long_enough(motion, change_points(motion))

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        return _long_enough(motion, finer_points(motion, setting))

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        model = motion.model
        return () if model is None else tuple(_share(name) for name, _ in _payload_energies(model))

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.model is None or motion.model.energy is None:
            return "a payload change requires a model with an energy: fit with 'potential'"
        if not motion.model.energy.indices.any():
            return 'the model has no gravity torque'
        points = change_points(motion)
        if not points:
            return 'there is no possible change point'
        if not _long_enough(motion, points):
            return (f'the recordings take {recorded_time(motion.samples):.1f} s: a payload change '
                    f'requires {_MIN_DURATION:.0f} s of motion before and after it')
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        columns = self.columns(motion, joint, setting)
        torque = np.abs(values) * np.sqrt((columns ** 2).mean(axis=(0, 1)))
        symbols = [c.symbol for c in self.coefficients_of(motion, joint, setting)]
        return (super().implausible(values, setting, motion, joint)
                or _outer_moments_unchanged(symbols, values, torque))


def _long_enough(motion: Motion, points: list[dict[str, float]]) -> list[dict[str, float]]:
    """Return the change points with enough motion before and after them."""
    seconds = recorded_time(motion.samples)
    before = [seconds * float((change_factor(motion, point) < 0.0).mean()) for point in points]
    return [point for point, time in zip(points, before)
            if min(time, seconds - time) >= _MIN_DURATION - _ROUNDING]


def _payload_energies(model: GravityModel) -> list[tuple[str, Expansion]]:
    """Return the energies in J that a payload at the last link changes, with their symbols."""
    n = model.n_joints
    if model.energy is None:
        return []
    parts = terms.by_last_joint(model.energy, n)
    energies = [(f'm_{joint + 1}', part) for joint, part in parts.items()]
    if not parts:
        return energies
    last = max(parts)
    slope = terms.pruned(parts[last].gradient(n, last))
    if last == n - 1:
        return [*energies, ('e', slope)]
    off_axis = [slope] if last == n - 2 else []
    if off_axis and n > 2:
        lateral = terms.lateral(parts[last], n, last, last - 1)
        off_axis += [lateral] if lateral is not None else []
    for part, name in zip(off_axis, ('e', 'f')):
        energies += [(f'{name}_{kind}', terms.times(part, n, n - 1, factor))
                     for kind, factor in (('s', dictionary.SIN), ('c', dictionary.COS))]
    return energies


def _outer_moments_unchanged(symbols: Sequence[str], values: FloatArray,
                             torque: FloatArray) -> str | None:
    """
    Return the reason if a change does not affect the first moments further out.

    A mass m at the tool adds m a_i to the first moment of a link of length a_i. That moment is at
    most a_i times the mass that the link carries, which decreases outwards. So the relative
    change increases outwards, for links with a length. Moments with little torque are ignored.

    :param torque: (K,) the RMS torque of each value in N·m.
    """
    moments = [symbol for symbol in symbols if symbol.startswith('m_')]
    shares = {symbol: abs(float(value)) for symbol, value, size in zip(symbols, values, torque)
              if symbol in moments and size >= _MIN_TORQUE * torque.max()}
    largest = max(shares, key=lambda name: shares[name], default='')
    outer = moments[moments.index(largest) + 1:] if largest else []
    largest_outer = max((shares.get(name, 0.0) for name in outer), default=0.0)
    if len(outer) > _WRIST and largest_outer < _MIN_OUTER * shares[largest]:
        return (f'only the first moment about joint number {largest[2:]} changes; a payload '
                f'changes those of the joints further out by a larger share')
    return None


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
    source = ('R. Featherstone, Rigid Body Dynamics Algorithms, Springer, 2008 (J^T f); derived '
              'in effects/payload.py')
    scope = 'arm'
    per_joint = False
    pointwise = True

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

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        # Large terms that cancel in this motion do not cancel in another one.
        total = np.abs(self.columns(motion, joint, setting) * values).sum(axis=2) / _CANCELLATION
        if reason := too_much_torque(total, motion, joint):
            return f'its terms cancel each other: {reason}'
        return super().implausible(values, setting, motion, joint)


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
