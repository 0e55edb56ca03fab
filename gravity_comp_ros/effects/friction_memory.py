"""
Friction with a state: warm-up since the start of a session, and distance since a reversal.

The distance starts again with every run, since earlier motion is unknown. The time of a session
continues over all recordings with stamps on one clock.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.clock import (
    longest_session, refined_time, session_of, since, time_constants)
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.friction import DRY
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import (
    DISTANCES, law_of, LAW_UNITS, laws, refined_laws, SHORTEST)
from gravity_comp_ros.effects.refining import scaled
import numpy as np

# Minimum duration of a session, in s.
_MIN_DURATION = 300.0


class FrictionDrift(Effect):
    """Time constants from a tenth of the longest session to three times it are compared."""

    name = 'friction_drift'
    title = 'Warm-up of friction'
    family = 'friction'
    equation = 'tau_n = (F_w d_n + B_w dq_n) (exp(-t / T) - 1), t from the start of the session'
    description = ('Friction that decreases (or, if negative, increases) with time as the gear '
                   'warms up.')
    coefficients = (Coefficient('F_w', 'N·m', 'dry friction that the gear loses as it warms up'),
                    Coefficient('B_w', 'N·m·s/rad', 'viscous friction that it loses'))
    confounders = ('torque_drift', 'coulomb_friction', 'viscous_friction', 'degressive_friction')
    experiment = ('repeat the same motion of joint {joint} for 20 minutes from a cold start, and '
                  'again when warm')
    signature = 'time'
    uses_gravity = False
    source = ('A. C. Bittencourt, S. Gunnarsson, Static friction in a robot joint: modeling and '
              'identification of load and temperature effects, ASME Journal of Dynamic Systems, '
              'Measurement and Control 134, 2012')
    setting_units = {'time': 's', 'origin': 's', 'end': 's', **LAW_UNITS}
    common = tuple(LAW_UNITS)
    # Half of the friction of a joint is lost at most: `CoulombFriction`, `ViscousFriction`.
    shares = (0.05, 0.5)
    corrects = ('coulomb_friction', 'viscous_friction', 'asymmetric_friction',
                'load_dependent_friction', 'coupled_friction')

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        warmth = np.expm1(-since(motion.samples, setting) / setting['time'])
        speed = motion.samples.qd[:, joint]
        return np.column_stack([motion.direction(joint, law_of(setting)), speed]) * warmth[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        session, noise = session_of(motion.samples), float(motion.speed_noise[joint])
        middle = [law for law in laws(noise) if law.get('distance', DISTANCES[2]) == DISTANCES[2]]
        return [{'time': time, **session, **law}
                for time in time_constants(motion.samples)
                for law in (middle[0], middle[-1])]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        return [*refined_time(setting, step, time_constants(motion.samples)),
                *refined_laws(setting, step, float(motion.speed_noise[joint]))]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        reason = excitation.insufficient_directions(motion, joint)
        longest = longest_session(motion.samples)
        if reason is None and longest < _MIN_DURATION:
            return (f'the longest session takes {longest:.3g} s, too short for a warm-up of '
                    f'friction')
        return reason


class PreslidingHysteresis(Effect):
    """
    Distances longer than those of a reversal, and the rate at which friction builds up.

    Far from reversals z and z_0, which builds up over the shortest distance, are equal: the
    friction there is Coulomb friction.
    """

    name = 'presliding_hysteresis'
    title = 'Presliding hysteresis'
    family = 'friction'
    equation = ('tau_n = F_p (z - z_0) + sigma dz/dt, dz/dq_n = (1 - z sign(dq_n)) / distance')
    description = ('Friction that builds up over a distance after a reversal, with a damping '
                   'while it builds up. It corrects Coulomb friction near reversals.')
    coefficients = (Coefficient('F_p', 'N·m', 'part of the friction that builds up over the '
                                              'distance'),
                    Coefficient('sigma', 'N·m·s', 'damping while it builds up'))
    confounders = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'joint_spring',
                   'time_delay')
    experiment = ('move joint {joint} back and forth over 0.2, 1 and 5 degrees at very low speed, '
                  'several times each')
    signature = 'position'
    uses_gravity = False
    source = ('P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, '
              '1968; P. Dupont et al., Single state elastoplastic friction models, IEEE '
              'Transactions on Automatic Control 47, 2002')
    setting_units = {'distance': 'rad'}
    corrects = DRY
    shares = (0.1, 0.02)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        z = motion.direction(joint, setting)
        rate = np.concatenate([_rate(z[run], motion.samples.t[run])
                               for run in run_slices(motion.samples)])
        return np.column_stack([z - motion.direction(joint, SHORTEST), rate])

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{'distance': d} for d in (*DISTANCES[1:], 0.06)
                if d < 0.2 * excitation.travel(motion, joint)]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        return scaled(setting, 'distance', step)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return (excitation.insufficient_directions(motion, joint)
                or excitation.insufficient_reversals(motion, joint))


def _rate(z: FloatArray, t: FloatArray) -> FloatArray:
    return np.gradient(z, t) if len(z) > 1 else np.zeros_like(z)


EFFECTS = (FrictionDrift(), PreslidingHysteresis())
