"""
Friction with a memory: of how long the arm has run, and of how far it has moved since it turned.

The memory of motion starts anew with every run, since what came before it is unknown. That of
time starts with a session: recordings with stamps on one clock go on with one another.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import run_slices, session_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation as facts
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.friction import DRY
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.presliding import presliding_state, steady_path
import numpy as np

_SHORTEST_RUN = 60.0
# Gears warm up over minutes.
_SHORTEST_TIME = 15.0
_TIMES = 5
# Distances over which friction builds up after a reversal, rad at the joint; over shorter ones
# the direction itself turns.
_DISTANCES = (1e-3, 0.1)
_DISTANCE_COUNT = 6
# Root mean square that a column of presliding, at most 2, must have to be seen.
_SEEN = 0.02


class FrictionDrift(Effect):
    """Time constants are tried from a tenth of the longest session to one and a half times it."""

    name = 'friction_drift'
    title = 'Friction that warms up'
    family = 'friction'
    equation = 'tau_n = F_w d_n exp(-t / T), t from the start of the session'
    description = ('Friction that falls (or, if negative, rises) with time as the gear warms up. '
                   'Recordings with stamps on one clock are one session.')
    coefficients = (Coefficient('F_w', 'N·m', 'friction at the start beyond that of a warm '
                                              'gear'),)
    confounders = ('torque_drift', 'coulomb_friction', 'viscous_friction', 'degressive_friction')
    experiment = ('move joint {joint} to and fro in the same way for 20 minutes from cold, and '
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
            max(0.1 * longest, _SHORTEST_TIME), 1.5 * longest, _TIMES)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        return [{'time': setting['time'] * factor} for factor in (0.75, 1.33)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        reason = facts.lacks_both_ways(motion, joint)
        longest = _longest(motion)
        if reason is None and longest < _SHORTEST_RUN:
            return (f'the longest recording takes {longest:.3g} s, too short for friction to '
                    f'change')
        return reason


def _longest(motion: Motion) -> float:
    return float(session_time(motion.samples).max(initial=0.0))


class PreslidingHysteresis(Effect):
    """Distances are tried that the joint passes often and that leave a trace."""

    name = 'presliding_hysteresis'
    title = 'Friction that builds up after a reversal'
    family = 'friction'
    equation = 'tau_n = F_p (z - d_n), dz/dq_n = (1 - z sign(dq_n)) / distance'
    description = ('Friction that does not jump when the joint turns back, but builds up over '
                   'some way; it corrects Coulomb friction near reversals.')
    coefficients = (Coefficient('F_p', 'N·m', 'friction that builds up over the distance'),)
    confounders = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'joint_spring',
                   'time_delay')
    experiment = ('move joint {joint} to and fro over ways of 0.2, 1 and 5 degrees at creeping '
                  'speed, several times each')
    signature = 'position'
    source = ('P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, '
              '1968; P. Dupont et al., Single state elastoplastic friction models, IEEE '
              'Transactions on Automatic Control 47, 2002')
    setting_units = {'distance': 'rad'}
    corrects = DRY
    why_not_negative = 'friction would come before the motion'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        runs = run_slices(motion.samples)
        key = f'path {joint}'
        if key not in motion.memo:
            motion.memo[key] = np.concatenate([
                steady_path(motion.samples.q[run, joint], motion.samples.t[run])
                for run in runs])
        column = -motion.direction(joint)
        for run in runs:
            column[run] += presliding_state(motion.memo[key][run], setting['distance'])
        return column[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        longest = min(_DISTANCES[1], 0.2 * facts.travel(motion, joint))
        if longest <= _DISTANCES[0]:
            return []
        grid = np.geomspace(_DISTANCES[0], longest, _DISTANCE_COUNT)
        found = [{'distance': float(d)} for d in grid]
        return [s for s in found
                if float(np.sqrt(np.mean(self.columns(motion, joint, s) ** 2))) > _SEEN]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        return [{'distance': max(setting['distance'] * factor, _DISTANCES[0])}
                for factor in (0.6, 1.6)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return facts.lacks_both_ways(motion, joint) or facts.lacks_reversals(motion, joint)


EFFECTS = (FrictionDrift(), PreslidingHysteresis())
