"""
Friction with a state: warm-up since the start of a session, and distance since a reversal.

The distance starts again with every run, since earlier motion is unknown. The time of a session
continues over all recordings with stamps on one clock.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import run_slices, session_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.friction import DRY
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.presliding import denoised_path, presliding_state
import numpy as np

# Minimum duration of a session, minimum time constant, in s, and number of time constants.
_MIN_DURATION = 60.0
_MIN_TIME = 15.0
_TIMES = 5
# Range of distances, in rad, over which friction builds up after a reversal, and their number.
# Shorter distances are part of the direction of motion.
_DISTANCES = (1e-3, 0.1)
_DISTANCE_COUNT = 6
# Minimum RMS of a presliding column, which is at most 2.
_MIN_RMS = 0.02


class FrictionDrift(Effect):
    """Time constants from a tenth of the longest session to 1.5 times it are compared."""

    name = 'friction_drift'
    title = 'Warm-up of friction'
    family = 'friction'
    equation = 'tau_n = F_w d_n exp(-t / T), t from the start of the session'
    description = ('Friction that decreases (or, if negative, increases) with time as the gear '
                   'warms up. Recordings with stamps on one clock are one session.')
    coefficients = (Coefficient('F_w', 'N·m', 'initial friction in excess of that of a warm '
                                              'gear'),)
    confounders = ('torque_drift', 'coulomb_friction', 'viscous_friction', 'degressive_friction')
    experiment = ('repeat the same motion of joint {joint} for 20 minutes from a cold start, and '
                  'again when warm')
    signature = 'time'
    source = ('A. C. Bittencourt, S. Gunnarsson, Static friction in a robot joint: modeling and '
              'identification of load and temperature effects, ASME Journal of Dynamic Systems, '
              'Measurement and Control 134, 2012')
    setting_units = {'time': 's'}
    corrects = ('coulomb_friction', 'viscous_friction', 'asymmetric_friction',
                'load_dependent_friction', 'coupled_friction')

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        warmth = np.exp(-session_time(motion.samples) / setting['time'])
        return (motion.direction(joint) * warmth)[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        longest = _longest(motion)
        return [{'time': float(t)} for t in np.geomspace(
            max(0.1 * longest, _MIN_TIME), 1.5 * longest, _TIMES)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        return [{'time': setting['time'] * factor} for factor in (0.75, 1.33)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        reason = excitation.insufficient_directions(motion, joint)
        longest = _longest(motion)
        if reason is None and longest < _MIN_DURATION:
            return (f'the longest session takes {longest:.3g} s, too short for a warm-up of '
                    f'friction')
        return reason


def _longest(motion: Motion) -> float:
    return float(session_time(motion.samples).max(initial=0.0))


class PreslidingHysteresis(Effect):
    """Distances up to a fifth of the travel with sufficient excitation are compared."""

    name = 'presliding_hysteresis'
    title = 'Presliding hysteresis'
    family = 'friction'
    equation = 'tau_n = F_p (z - d_n), dz/dq_n = (1 - z sign(dq_n)) / distance'
    description = ('Friction that builds up over a distance after a reversal instead of a jump. '
                   'It corrects Coulomb friction near reversals.')
    coefficients = (Coefficient('F_p', 'N·m', 'friction torque that builds up over the '
                                              'distance'),)
    confounders = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'joint_spring',
                   'time_delay')
    experiment = ('move joint {joint} back and forth over 0.2, 1 and 5 degrees at very low speed, '
                  'several times each')
    signature = 'position'
    source = ('P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, '
              '1968; P. Dupont et al., Single state elastoplastic friction models, IEEE '
              'Transactions on Automatic Control 47, 2002')
    setting_units = {'distance': 'rad'}
    corrects = DRY
    why_not_negative = 'friction would precede the motion'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        runs = run_slices(motion.samples)
        key = f'path {joint}'
        if key not in motion.memo:
            motion.memo[key] = np.concatenate([
                denoised_path(motion.samples.q[run, joint], motion.samples.t[run])
                for run in runs])
        column = -motion.direction(joint)
        for run in runs:
            column[run] += presliding_state(motion.memo[key][run], setting['distance'])
        return column[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        longest = min(_DISTANCES[1], 0.2 * excitation.travel(motion, joint))
        if longest <= _DISTANCES[0]:
            return []
        grid = np.geomspace(_DISTANCES[0], longest, _DISTANCE_COUNT)
        settings = [{'distance': float(d)} for d in grid]
        return [s for s in settings
                if float(np.sqrt(np.mean(self.columns(motion, joint, s) ** 2))) > _MIN_RMS]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        return [{'distance': max(setting['distance'] * factor, _DISTANCES[0])}
                for factor in (0.6, 1.6)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return (excitation.insufficient_directions(motion, joint)
                or excitation.insufficient_reversals(motion, joint))


EFFECTS = (FrictionDrift(), PreslidingHysteresis())
