"""
A client that plays an arm to the running node, and judges every torque that it publishes.

The arm is a simulated iiwa with a payload. Its poses are stamped 0.2 s apart and sent faster, so
that a minute of slow motion takes a second. Each published torque is compared with the true torque
of the pose that it answers.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import sys
import time

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'test'))
ARM = iiwa7()
PERIOD, STEP = 0.006, 0.2
NOISE = 0.1
# Hz; joint states of an arm that is led by hand.
LED = 50.0
# N·m by which a torque may be further from the truth than the model before.
WRONG = 1.0
# The motion is played faster than it is, and so must torque follow.
RATE = 10000.0
# A pose 0.2 s further on changes no torque by more than this, N·m.
JUMP = 20.0
PARAMETERS: dict[str, object] = {
    'ramp_time': 0.1, 'max_torque': '[176.0]', 'max_torque_rate': f'[{RATE}]',
    'stale_after': 10.0, 'stale_action': 'hold', 'settle_time': 0.0, 'diagnostics_rate': 20.0,
    'formulation': 'auto'}

Spoil = Callable[[FloatArray, np.random.Generator], FloatArray]


def describe(probe, text: str) -> None:
    """Publish a robot description, once and for those who come later."""
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import String
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = probe.create_publisher(String, 'robot_description', latched)
    publisher.publish(String(data=text))
    probe.until(lambda: publisher.get_subscription_count() > 0)
    probe.spin(0.5)


def healthy(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the effort as it is."""
    return tau


class Player:
    """Moves the arm, sends what its sensors say, and keeps what the node publishes."""

    def __init__(self, probe, model: GravityModel, payload: Payload | None = None,
                 seed: int = 0) -> None:
        self.probe, self.model = probe, model
        self.rng = np.random.default_rng(seed)
        self.t = 1000.0 + 100.0 * seed
        self.poses: dict[tuple[int, int], FloatArray] = {}
        self.wrong: list[str] = []
        self.judged = 0
        self.carry(payload)

    def carry(self, payload: Payload | None) -> None:
        """Put a payload on the last link, or none."""
        self.arm = ARM if payload is None else with_payload(ARM, payload)

    def move(self, n: int, spoil: Spoil = healthy, period: float = PERIOD, **change) -> None:
        """
        Send n joint states of slow motion.

        :param spoil: what is reported instead of the true torque.
        :param change: fields of every message that are replaced: `velocity`, `turn` (rad added
            to all positions), `scale` (of positions), `stamp`.
        """
        part = eq17(n * STEP, 1.0 / STEP, self.t)
        tau = gravity_torque(self.arm, part.q) + NOISE * self.rng.standard_normal(part.q.shape)
        effort = spoil(tau, self.rng)
        due = time.monotonic()
        for k in range(n):
            t = self.t + STEP * k
            q = part.q[k]
            self.poses[int(t), round((t - int(t)) * 1e9)] = q
            sent = q * change.get('scale', 1.0) + change.get('turn', 0.0)
            self.probe.send(ARM.joints, change.get('stamp', t), sent,
                            change.get('velocity', part.qd[k]), effort[k])
            due += period
            self.probe.spin(max(1e-4, due - time.monotonic()))
        self.t += STEP * n

    def error(self) -> float:
        """Return how far the last torque is from the truth of the last pose, N·m."""
        pose = list(self.poses.values())[-1]
        truth = gravity_torque(self.arm, pose[None])[0]
        return float(np.abs(np.array(self.probe.torques[-1].effort) - truth).max())

    def listen_for_payloads(self) -> list[str]:
        """Return a list that every payload suspected from now on is added to, as a sentence."""
        from diagnostic_msgs.msg import DiagnosticArray
        events: list[str] = []
        self.probe.create_subscription(
            DiagnosticArray, '/gravity_comp/payload_suspected',
            lambda message: events.append(message.status[0].message), 10)
        self.probe.spin(0.5)
        return events

    def jump(self, t: float) -> None:
        """Go to another part of the motion; what is published on the way is not judged."""
        self.t = t
        self.move(30)
        self.probe.spin(0.3)
        self.probe.torques.clear()

    def lead(self, seconds: float) -> None:
        """Lead the arm by hand, as fast as it is: its effort is what the node published last."""
        part = eq17(seconds, LED, self.t)
        due = time.monotonic()
        for k, t in enumerate(part.t):
            self.poses[int(t), round((t - int(t)) * 1e9)] = part.q[k]
            torques = self.probe.torques
            effort = np.array(torques[-1].effort) if torques else np.zeros(7)
            self.probe.send(ARM.joints, t, part.q[k], part.qd[k],
                            effort + 0.02 * self.rng.standard_normal(7))
            due += 1.0 / LED
            self.probe.spin(max(1e-4, due - time.monotonic()))
        self.t += seconds

    def settle(self, seconds: float = 60.0) -> None:
        """Wait until no fit runs and none is due, and what was sent has been answered."""
        self.probe.spin(0.1)
        quiet = 0
        end = time.monotonic() + seconds
        while quiet < 3 and time.monotonic() < end:
            self.probe.report('learning')
            state = self.probe.values('learning').get('fit process')
            quiet = quiet + 1 if state == 'ready' else 0

    def judge(self, what: str, ramps: bool = False) -> None:
        """
        Judge every torque that came since the last call.

        It must be no further from the truth than the model that the node began with, and 1 N·m.

        :param ramps: torque may be on its way up from zero, or down to it.
        """
        last: FloatArray | None = None
        for message in self.probe.torques:
            tau = np.array(message.effort)
            stamp = message.header.stamp.sec, message.header.stamp.nanosec
            pose = self.poses.get(stamp)
            if not np.isfinite(tau).all() or np.abs(tau).max() > 176.0:
                self.wrong.append(f'{what}: {tau} is no torque')
            if pose is None:
                continue
            self.judged += 1
            truth = gravity_torque(self.arm, pose[None])[0]
            allowed = WRONG + np.abs(self.model.predict_one(pose) - truth)
            # Torque that ramps lies between none and that of a right model.
            error = np.abs(tau - truth) if not ramps else np.maximum(
                np.abs(tau) - np.abs(truth), -np.sign(truth) * tau)
            if (error > allowed).any():
                k = int(np.argmax(error - allowed))
                self.wrong.append(f'{what}: {ARM.joints[k]} {tau[k]:.2f} N·m, truth '
                                  f'{truth[k]:.2f}, allowed {allowed[k]:.2f}')
            if last is not None and np.abs(tau - last).max() > JUMP:
                self.wrong.append(f'{what}: a step of {np.abs(tau - last).max():.1f} N·m')
            last = tau
        self.probe.torques.clear()
        self.probe.commands.clear()

    def model_in_use(self) -> str:
        """Return what the status says of the model."""
        return str(self.probe.report('model').message)
