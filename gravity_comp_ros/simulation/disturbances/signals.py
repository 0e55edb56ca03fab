"""Torques of the angle, faults of sensors, elastic gears, and disturbances of the whole arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, gravity_torque, with_base_tilt
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pinocchio as pin


@dataclass(frozen=True)
class Change:
    """A disturbance as a function, and its joint, counted from 0 (None: the whole arm)."""

    apply: Callable[[Signals, Motion, Arm], Signals]
    joint: int | None = None


def added_torque(joint: int, torque: Callable[[Signals, Motion], FloatArray]) -> Change:
    """Return a torque (M,) in N·m that is added to that of a joint."""
    def apply(signals: Signals, motion: Motion, arm: Arm) -> Signals:
        tau = signals.tau.copy()
        tau[:, joint] += torque(signals, motion)
        return replace(signals, tau=tau)
    return Change(apply, joint)


def angle_torque(joint: int, torque: Callable[[FloatArray], FloatArray]) -> Change:
    """Return a torque that is a function of the joint's angle (K,) in rad alone."""
    return added_torque(joint, lambda signals, motion: torque(motion.q[:, joint]))


def spring_balancer(joint: int, stiffness: float, crank: float = 0.1, post: float = 0.6) -> Change:
    """
    Return a spring from the link, `crank` m from the joint's axis, to the base, `post` m from it.

    Its length follows from the law of cosines, l^2 = crank^2 + post^2 - 2 crank post cos(q), and
    is free at q = 0. The torque is `stiffness` N·m at 1 rad.

    The torque of a spring of free length 0 is a sine of the angle, collinear with gravity.
    """
    def torque(q: FloatArray) -> FloatArray:
        length = np.sqrt(crank ** 2 + post ** 2 - 2 * crank * post * np.cos(q))
        return np.asarray((length - (post - crank)) * np.sin(q) / length)

    return angle_torque(joint, lambda q: stiffness / torque(np.array(1.0)) * torque(q))


def detent(joint: int, centre: float, peak: float, width: float = 0.06) -> Change:
    """
    Return a potential well E(q) = -depth exp(-((q - centre) / width)^2 / 2).

    `centre` and `width` in rad. The drive's torque is dE/dq, at most `peak` N·m, one width from
    the centre.
    """
    def torque(q: FloatArray) -> FloatArray:
        x = (q - centre) / width
        return np.asarray(peak * x * np.exp(0.5 - x ** 2 / 2))
    return angle_torque(joint, torque)


def dress_pack(joint: int, slack: float, stiffness: float, hardening: float = 3.0,
               side: int = 1) -> Change:
    """
    Return a cable pack that is taut beyond the angle `slack` on one `side` (+1 or -1).

    With the stretch s = max(side (q - slack), 0) in rad the torque is

        stiffness * hardening * (exp(s / hardening) - 1):

    `stiffness` N·m/rad at s = 0, and e times that at s = `hardening` rad.
    """
    return angle_torque(joint, lambda q: side * stiffness * hardening * np.expm1(
        np.maximum(side * (q - slack), 0.0) / hardening))


def cogging(joint: int, teeth: int, peak: float, sharpness: float = 0.5,
            phase: float = 0.0) -> Change:
    """
    Return periodic pulses, `teeth` per revolution of the joint, with a peak of `peak` N·m.

    Each pulse is exp((cos x - 1) / sharpness) with x = teeth (q - phase): round for a
    sharpness of 1 and more, narrow below. The mean is subtracted, so that a revolution takes no
    energy.
    """
    def pulses(angle: FloatArray) -> FloatArray:
        return np.asarray(np.exp((np.cos(angle) - 1) / sharpness))

    mean = float(pulses(2 * np.pi * np.arange(720) / 720).mean())
    return angle_torque(joint, lambda q: peak * (
        pulses(teeth * (q - phase)) - mean) / (1 - mean))


def bumper(joint: int, at: float, stiffness: float) -> Change:
    """Return a contact beyond the angle `at` in rad, whose torque rises as depth^1.2."""
    return angle_torque(joint, lambda q: stiffness * np.maximum(q - at, 0.0) ** 1.2)


def gauge_offset(joint: int, offset: float) -> Change:
    """Return a torque sensor with an offset of `offset` N·m."""
    return added_torque(joint, lambda signals, motion: np.full(len(motion.t), offset))


def gauge_gain(joint: int, gain: float) -> Change:
    """Return a torque sensor that reads `gain` times the torque."""
    return added_torque(joint, lambda signals, motion: (gain - 1.0) * signals.tau[:, joint])


def gauge_drift(joint: int, rise: float, warming: float = 200.0, begun: float = 0.0,
                lag: float = 0.0) -> Change:
    """
    Return the drift of a torque sensor with its temperature.

    The mount warms as 1 - exp(-t / warming); the sensor follows with a time constant of `lag`
    times `warming`. Its offset rises by `rise` N·m with its temperature. The sensor was switched
    on `begun` s before the run.
    """
    def torque(signals: Signals, motion: Motion) -> FloatArray:
        age = motion.t - motion.t[0] + begun
        sensor = lag * np.exp(-age / (lag * warming)) if lag else 0.0
        return np.asarray(rise * (1.0 - (np.exp(-age / warming) - sensor) / (1.0 - lag)))
    return added_torque(joint, torque)


def encoder_offset(joint: int, offset: float) -> Change:
    """
    Return a joint whose reported angle is `offset` rad too large.

    An offset that is the same in all recordings is not identifiable: a sum of products of sines
    and cosines of shifted angles is another such sum.
    """
    return gear(joint, lambda load: np.full(len(load), offset))


def gear(joint: int, lead: Callable[[FloatArray], FloatArray]) -> Change:
    """
    Return a gear whose reported (motor) angle is ahead of that of the link.

    :param lead: lead (M,) in rad by the load (M,) in N·m: load / stiffness of an elastic gear.
    """
    def apply(signals: Signals, motion: Motion, arm: Arm) -> Signals:
        ahead = lead(signals.tau[:, joint])
        q, qd = signals.q.copy(), signals.qd.copy()
        q[:, joint] += ahead
        if len(ahead) > 1:
            qd[:, joint] += np.gradient(ahead, motion.t)
        return replace(signals, q=q, qd=qd)
    return Change(apply, joint)


def delayed_effort(delay: float) -> Change:
    """
    Return effort delayed by `delay` s.

    It is interpolated linearly between samples, which must resolve the torque. Before the first
    sample the torque is that of the first.
    """
    return Change(lambda signals, motion, arm: replace(signals, tau=np.stack([
        np.interp(motion.t - delay, motion.t, tau) for tau in signals.tau.T], axis=1)))


def tilted_base(roll: float) -> Change:
    """Return a base rotated by `roll` rad about x."""
    def apply(signals: Signals, motion: Motion, arm: Arm) -> Signals:
        change = gravity_torque(with_base_tilt(arm, roll, 0.0), motion.q) - gravity_torque(
            arm, motion.q)
        return replace(signals, tau=signals.tau + change)
    return Change(apply)


def tool_force(force: tuple[float, float, float],
               point: tuple[float, float, float] = (0.0, 0.0, 0.1)) -> Change:
    """
    Return a `force` in N on the last link, constant in its frame, at `point` in m in that frame.

    The drives compensate it.
    """
    wrench = np.concatenate([force, np.cross(point, force)])

    def apply(signals: Signals, motion: Motion, arm: Arm) -> Signals:
        data, last = arm.model.createData(), arm.model.njoints - 1
        zero, tau = pin.neutral(arm.model), signals.tau.copy()
        for row, pose in zip(tau, motion.q):
            configuration = pin.integrate(arm.model, zero, pose)
            row -= pin.computeJointJacobian(arm.model, data, configuration, last).T @ wrench
        return replace(signals, tau=tau)
    return Change(apply)
