"""
What the tool does: a payload that changes on the way, and a force that turns with the tool.

Neither needs kinematics. A mass at the tool adds to every first moment h_i of the chain, mostly
along what is there already: so the parts of the energy, by the last joint in their features,
grow each by a factor. A payload beside the axis of the last joint adds features of that joint,
whose direction of gravity is made of other components of the one before (`energy_terms`).
A force fixed in the tool, such as the pull of a hose, looks from the tool like gravity looks
from the base: the torque of joint n depends only on the joints after n, never on its own angle,
which no gravity torque does. It does no honest work along a closed path.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from gravity_comp_ros.data.runs import recorded_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import energy_terms as terms, excitation as facts
from gravity_comp_ros.effects.change_points import (
    change, change_points, finer_points, UNITS)
from gravity_comp_ros.effects.effect import Coefficient, Coefficients, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.plausibility import too_much_torque
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion
import numpy as np

# s: shorter motion before a change or after it shows other poses, not another payload.
_SHORTEST = 10.0
# s: a share of the samples tells the time to about a sample.
_ROUNDING = 0.1
# The last joints get every feature, the one before them those of two factors.
_EXACT_JOINTS = 3
# Tool forces show in what a joint would lack otherwise; joints must move for it.
_LEAST_TRAVEL = 0.1
# The sizes of all terms of a force add up to this many times its largest torque, no more.
_CANCELLING = 3.0
# The largest share of a payload is reached at least to this part further out, but for the links of
# a wrist, which may have no length: so many joints are not asked.
_REACHES, _WRIST = 0.5, 2
# A part of the energy counts if its change makes this part of the largest change of torque.
_COUNTS = 0.02


def _share(name: str) -> Coefficient:
    kind, _, place = name.partition('_')
    if kind == 'm':
        return Coefficient(name, '', f'change of the first moment that joint number {place} '
                                     'turns, relative to that after it')
    return Coefficient(name, '', 'first moment beside the last axis, relative to that of the '
                                 'joint before it')


class PayloadChange(Effect):
    """The columns are the torque of each energy, negative before the change and 0 after it."""

    name = 'payload_change'
    title = 'Payload that changes on the way'
    family = 'payload'
    equation = ('tau = -sum_i m_i dU_i(q)/dq before the change, U_i the part of the energy that '
                'joint i turns last')
    description = ('A tool or load that is taken up or set down during the recording. Gravity is '
                   'that of the end: later recordings are predicted with the last payload.')
    coefficients = (_share('m_i'), _share('e_s'))
    confounders = ('torque_gain', 'torque_drift', 'encoder_offset', 'base_tilt')
    experiment = ('record one run with the load and one without it, and learn the change with '
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
        return motion.memo['payload'] * change(motion, setting)[:, None, None]

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
            return "payload changes are told from a model with an energy: fit with 'potential'"
        if not motion.model.energy.indices.any():
            return 'the model has no gravity that a payload could add to'
        points = change_points(motion)
        if not points:
            return 'there is no time before and after'
        if not _long_enough(motion, points):
            return (f'the recordings take {recorded_time(motion.samples):.1f} s: a payload needs '
                    f'{_SHORTEST:.0f} s of motion before its change and after it')
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        columns = self.columns(motion, joint, setting)
        torque = np.abs(values) * np.sqrt((columns ** 2).mean(axis=(0, 1)))
        symbols = [c.symbol for c in self.coefficients_of(motion, joint, setting)]
        return (super().implausible(values, setting, motion, joint)
                or _not_further_out(symbols, values, torque))


def _long_enough(motion: Motion, points: list[dict[str, float]]) -> list[dict[str, float]]:
    """Return the settings of a change with enough motion before it and after it."""
    seconds = recorded_time(motion.samples)
    before = [seconds * float((change(motion, point) < 0.0).mean()) for point in points]
    return [point for point, time in zip(points, before)
            if min(time, seconds - time) >= _SHORTEST - _ROUNDING]


def _payload_energies(model: GravityModel) -> list[tuple[str, Expansion]]:
    """Return named energies in J that a payload at the last link adds to."""
    n = model.n_joints
    if model.energy is None:
        return []
    parts = terms.by_last_joint(model.energy, n)
    found = [(f'm_{joint + 1}', part) for joint, part in parts.items()]
    if not parts:
        return found
    deepest = max(parts)
    turned = terms.pruned(parts[deepest].gradient(n, deepest))
    if deepest == n - 1:
        return [*found, ('e', turned)]
    beside = [turned] if deepest == n - 2 else []
    if beside and n > 2:
        across = terms.lateral(parts[deepest], n, deepest, deepest - 1)
        beside += [across] if across is not None else []
    for part, name in zip(beside, ('e', 'f')):
        found += [(f'{name}_{kind}', terms.times(part, n, n - 1, factor))
                  for kind, factor in (('s', dictionary.SIN), ('c', dictionary.COS))]
    return found


def _not_further_out(symbols: Sequence[str], values: FloatArray,
                     torque: FloatArray) -> str | None:
    """
    Check that a change reaches the links further out.

    A mass m at the tool adds m a_i to the first moment of a link of length a_i, which is at most
    a_i times the mass that the link carries, and that is less the further out the link is. So
    the share grows outwards, where links have a length at all. Shares of moments too small to
    turn a joint are noise and do not count.

    :param torque: (K,) the root mean square of the torque that each of the values makes.
    """
    places = [symbol for symbol in symbols if symbol.startswith('m_')]
    shares = {symbol: abs(float(value)) for symbol, value, size in zip(symbols, values, torque)
              if symbol in places and size >= _COUNTS * torque.max()}
    largest = max(shares, key=lambda name: shares[name], default='')
    beyond = places[places.index(largest) + 1:] if largest else []
    reached = max((shares.get(name, 0.0) for name in beyond), default=0.0)
    if len(beyond) > _WRIST and reached < _REACHES * shares[largest]:
        return (f'the first moment that joint number {largest[2:]} turns changes and none beyond '
                f'it: a payload changes those by a larger share')
    return None


class ToolForce(Effect):
    """One column for each feature, which acts on its joint alone, (M, N, K)."""

    name = 'tool_force'
    title = 'Force fixed in the tool'
    family = 'payload'
    equation = 'tau_n = sum_k f_nk phi_k(q_n+1 ... q_N)'
    description = ('A force that turns with the tool, such as the pull of a hose: no weight makes '
                   'a torque that does not depend on the own angle of its joint.')
    coefficients = (Coefficient('f_n[phi]', 'N·m', 'torque on joint n'),)
    confounders = ('torque_offset',)
    experiment = 'take hoses and cables off the tool and record the same motion again'
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
            return 'on one joint a tool force is the same as an offset'
        if facts.travel(motion, n - 1) < _LEAST_TRAVEL and (
                n < 3 or facts.travel(motion, n - 2) < _LEAST_TRAVEL):
            return 'the last joints hardly move, so a tool force is the same as offsets'
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        # Terms of a force add to it. Large ones that cancel in this motion do not in the next.
        apart = np.abs(self.columns(motion, joint, setting) * values).sum(axis=2) / _CANCELLING
        if reason := too_much_torque(apart, motion, joint):
            return f'its terms cancel each other: {reason}'
        return super().implausible(values, setting, motion, joint)


def _tool_features(n_joints: int) -> list[tuple[int, int]]:
    """
    Return (joint, feature) pairs that a tool force may have.

    Features of the joints after `joint`: all of them for the last three joints, those of at
    most two factors for the one before. Earlier joints would need hundreds of features (or
    kinematics) and are left out, so that their part of the force stays unexplained.
    """
    found = []
    for joint in range(max(0, n_joints - _EXACT_JOINTS - 1), n_joints):
        most = n_joints if joint >= n_joints - _EXACT_JOINTS else 2
        after = n_joints - 1 - joint
        for tail in product(range(3), repeat=after):
            if sum(factor != dictionary.ONE for factor in tail) <= most:
                factors = np.array([[dictionary.ONE] * (joint + 1) + list(tail)])
                found.append((joint, int(dictionary.index_of(factors)[0])))
    return found


EFFECTS = (PayloadChange(), ToolForce())
