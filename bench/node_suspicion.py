#!/usr/bin/env python3
"""
False alarms and delay of `~/payload_suspected`, in `NodeCore`, faster than real time.

    python3 -m bench.node_suspicion [--hours 1] [--seeds 5] [--masses 0.5 1 2] [--axes]
                                    [--lasts 0.3 3] [--upright] [--varies 0.2]

An iiwa with Coulomb and viscous friction is learned from 100 s of slow motion. Then it moves from
pose to pose: slowly, fast (up to 1.5 rad/s, with inertia), with rests, one move of ten to a pose
outside the training. Friction drifts by a third in half an hour. About three times a minute a
contact force of 5 to 60 N acts on the last link for 0.3 to 3 s (`--lasts`), in a fixed random
direction (`--upright`: vertical) and constant (`--varies`: its relative standard deviation, within
two seconds). The payload does not change, so each event is a false alarm. For the delay the arm
carries a payload.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import sys
import time

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.simulation.arms import Arm, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17
import numpy as np
import pinocchio as pin
from sensor_msgs.msg import JointState

ROOT = Path(__file__).resolve().parents[1]
ARM = iiwa7()
RATE, NOISE = 25.0, 0.1
COULOMB = np.array([0.8, 1.2, 0.6, 0.8, 0.3, 0.3, 0.2])
VISCOUS = np.array([2.0, 3.0, 2.0, 2.0, 1.0, 1.0, 0.5])
WIDTH = 0.005
# Correlation time of the force of a hand, s.
FORCE_TIME = 2.0
# Relative amplitude and period, s, of the drift of friction.
DRIFT, DRIFT_PERIOD = 0.33, 3600.0


@dataclass(frozen=True)
class Sample:
    """State of motion of an arm at one time, in SI units."""

    t: float
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray


def moves(low: FloatArray, high: FloatArray, seconds: float, rng: np.random.Generator,
          start: float) -> Iterator[Sample]:
    """Yield motion from pose to pose with rests, some poses outside the range [low, high]."""
    t, q = start, 0.5 * (low + high)
    while t < start + seconds:
        outside = rng.random() < 0.1
        margin = 0.5 if outside else -0.02
        goal = rng.uniform(low - margin, high + margin)
        speed = rng.uniform(0.05, 0.14) if rng.random() < 0.6 else rng.uniform(0.3, 1.5)
        step = goal - q
        # The peak speed of a minimum-jerk move is 1.875 times its mean.
        duration = max(0.5, 1.875 * float(np.abs(step).max()) / speed)
        for k in range(int(duration * RATE)):
            s = k / (duration * RATE)
            yield Sample(t, q + step * (10 * s ** 3 - 15 * s ** 4 + 6 * s ** 5),
                         step * (30 * s ** 2 - 60 * s ** 3 + 30 * s ** 4) / duration,
                         step * (60 * s - 180 * s ** 2 + 120 * s ** 3) / duration ** 2)
            t += 1.0 / RATE
        q = goal
        for _ in range(int(rng.uniform(0.0, 3.0) * RATE)):
            yield Sample(t, q, np.zeros(7), np.zeros(7))
            t += 1.0 / RATE


def friction(t: float, qd: FloatArray) -> FloatArray:
    drift = 1.0 + DRIFT * np.sin(2.0 * np.pi * t / DRIFT_PERIOD)
    return drift * COULOMB * np.tanh(qd / WIDTH) + VISCOUS * qd


def force_torque(arm: Arm, data: pin.Data, q: FloatArray, force: FloatArray) -> FloatArray:
    """Return the torque (N,), N·m, of a force (3,) in base coordinates on the last link."""
    pin.forwardKinematics(arm.model, data, q)
    jacobian = pin.computeJointJacobian(arm.model, data, q, 7)
    return np.asarray((data.oMi[7].rotation @ jacobian[:3]).T @ force)


@dataclass(frozen=True)
class ContactOptions:
    """
    Contact forces on the last link.

    Each lasts for `duration` (minimum, maximum) s and begins on average `interval` s after the
    previous one. Its relative standard deviation is `force_std`; with `is_vertical` it is
    vertical.
    """

    duration: tuple[float, float] = (0.3, 3.0)
    interval: float = 20.0
    force_std: float = 0.0
    is_vertical: bool = False


class Contacts:
    """Random contact forces on the last link."""

    def __init__(self, rng: np.random.Generator,
                 options: ContactOptions = ContactOptions()) -> None:
        self._rng, self._options = rng, options
        self._next = self._until = -1.0
        self._force = np.zeros(3)
        self._variation = 0.0
        self.count = 0

    def torque(self, arm: Arm, data: pin.Data, s: Sample) -> FloatArray:
        """Return the torque of the contact force (N,), N·m."""
        rng = self._rng
        if s.t > self._next:
            if self._next >= 0.0:
                direction = rng.standard_normal(3)
                if self._options.is_vertical:
                    direction[:2] = 0.0
                self._force = rng.uniform(5.0, 60.0) * direction / np.linalg.norm(direction)
                self._until = s.t + rng.uniform(*self._options.duration)
                self.count += 1
            self._next = (s.t + self._options.duration[1]
                          + rng.exponential(self._options.interval))
        if s.t > self._until:
            return np.zeros(7)
        decay = np.exp(-1.0 / (RATE * FORCE_TIME))
        self._variation = (decay * self._variation
                           + np.sqrt(1.0 - decay ** 2) * rng.standard_normal())
        return force_torque(arm, data, s.q,
                            self._force * (1.0 + self._options.force_std * self._variation))


def learned(rng: np.random.Generator) -> GravityModel:
    """Return the model of the arm without payload, from 100 s of slow motion."""
    motion = eq17(100.0, 5.0)
    data = ARM.model.createData()
    tau = np.array([pin.rnea(ARM.model, data, *row) for row in
                    zip(motion.q, motion.qd, motion.qdd)])
    tau += np.array([friction(t, qd) for t, qd in zip(motion.t, motion.qd)])
    return fit(JointSamples.single_run(ARM.joints, motion.t, motion.q, motion.qd, tau
                                       + NOISE * rng.standard_normal(tau.shape)),
               FitOptions(formulation='auto')).model


class Core:
    """The node without ROS, with a model in use and a real fit process."""

    def __init__(self, model: GravityModel, axes: bool) -> None:
        self.live = NodeCore(
            Parameters(joints=ARM.joints, unlimited_torque=True, auto_fit=False, max_age=0.0,
                       stale_action='hold'), '/joint_states', 0.0)
        self.send(Sample(0.5, np.zeros(7), np.zeros(7), np.zeros(7)), np.zeros(7))
        if axes:
            self.live.describe((ROOT / 'bags' / 'iiwa7.urdf').read_text())
        self.live.models.use(model, 'bench', 0.0)
        assert self.live.arm is not None
        self.live.arm.use(model, None, 0)
        self.live.arm.epoch.is_open = False
        self.tests = 0

    @staticmethod
    def _message(s: Sample, tau: FloatArray) -> JointState:
        message = JointState(name=list(ARM.joints), position=s.q.tolist(),
                             velocity=s.qd.tolist(), effort=tau.tolist())
        message.header.stamp.sec = int(s.t)
        message.header.stamp.nanosec = min(int(round((s.t % 1.0) * 1e9)), 999_999_999)
        return message

    def send(self, s: Sample, tau: FloatArray) -> None:
        """Send a sample with the measured torque (N,) to the node."""
        reading = self.live.read(self._message(s, tau), s.t)
        if reading is not None:
            self.live.arm.torque(s.t, reading)
            self.live.arm.learn(reading, s.t)

    def run(self, source: Iterator[Sample], arm: Arm, rng: np.random.Generator,
            contacts: Contacts | None, until_event: bool) -> list[tuple[float, str]]:
        """Send motion; return the time and text of each event."""
        data, events = arm.model.createData(), []
        for s in source:
            tau = pin.rnea(arm.model, data, s.q, s.qd, s.qdd) + friction(s.t, s.qd)
            if contacts is not None:
                tau = tau + contacts.torque(arm, data, s)
            self.send(s, tau + NOISE * rng.standard_normal(7))
            self._finish_tests(s.t)
            while self.live.events.payloads:
                events.append((s.t, self.live.events.payloads.popleft().text))
            if events and until_event:
                break
        return events

    def _finish_tests(self, now: float) -> None:
        self.live.tick(now, time.monotonic())
        if self.live.fits.job is not None:
            self.tests += 1
        while self.live.fits.state != 'ready':
            time.sleep(0.002)
            self.live.tick(now, time.monotonic())


def false_alarms(model: GravityModel, hours: float, axes: bool, seed: int,
                 options: ContactOptions) -> int:
    rng = np.random.default_rng(seed)
    core, contacts = Core(model, axes), Contacts(rng, options)
    start = time.monotonic()
    low, high = model.coverage.q_min, model.coverage.q_max
    events = core.run(moves(low, high, 3600.0 * hours, rng, 10.0), ARM, rng, contacts, False)
    core.live.close()
    for t, text in events:
        print(f'  false alarm at {t:.0f} s: {text}')
    print(f'{hours:g} h of motion, {contacts.count} contacts, axes '
          f'{"known" if axes else "unknown"}: {len(events)} false alarms, {core.tests} windows '
          f'tested, {time.monotonic() - start:.0f} s', flush=True)
    return len(events)


def delay(model: GravityModel, payload: Payload, axes: bool, seed: int) -> float:
    """Return the time of motion in s until a payload is suspected, infinite if it is not."""
    rng = np.random.default_rng(100 + seed)
    core = Core(model, axes)
    low, high = model.coverage.q_min, model.coverage.q_max
    core.run(moves(low, high, 40.0, rng, 10.0), ARM, rng, None, False)
    start = 60.0
    events = core.run(moves(low, high, 300.0, rng, start), with_payload(ARM, payload), rng, None,
                      True)
    core.live.close()
    return events[0][0] - start if events else float('inf')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--hours', type=float, default=1.0)
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--masses', type=float, nargs='*', default=[0.5, 1.0, 2.0])
    parser.add_argument('--lasts', type=float, nargs=2, default=(0.3, 3.0),
                        help='shortest and longest contact, s')
    parser.add_argument('--upright', action='store_true', help='vertical contact forces')
    parser.add_argument('--varies', type=float, default=0.0,
                        help='relative standard deviation of a contact force')
    parser.add_argument('--seed', type=int, default=0, help='of the motion with contacts')
    parser.add_argument('--axes', action='store_true', help='the axes are known (URDF)')
    args = parser.parse_args()
    model = learned(np.random.default_rng(5))
    print(f'model {model.formulation}, residual {np.round(model.noise, 2).tolist()} N·m')
    for mass in args.masses:
        for centre in ((0.0, 0.0, 0.1), (0.1, -0.06, 0.1)):
            delays = [delay(model, Payload(mass, centre), args.axes, seed)
                      for seed in range(args.seeds)]
            print(f'{mass:g} kg at {centre}: suspected after {np.median(delays):.1f} s of motion '
                  f'(median), {min(delays):.1f} to {max(delays):.1f}', flush=True)
    if args.hours:
        contacts = ContactOptions(tuple(args.lasts), force_std=args.varies,
                                  is_vertical=args.upright)
        sys.exit(1 if false_alarms(model, args.hours, args.axes, args.seed, contacts) else 0)


if __name__ == '__main__':
    main()
