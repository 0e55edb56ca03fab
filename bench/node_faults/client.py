"""
Client that simulates an arm for the running node, and checks each published torque.

The arm is simulated, with a payload. Its poses are stamped 0.2 s apart and sent faster, so
that a minute of slow motion takes a second. Each published torque is compared with the true torque
at the pose of its stamp.
"""

from __future__ import annotations

from collections.abc import Callable
import time

from bench.node_faults.arms import NOISE, seven, TestArm
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.feedforward import RAMPING
from gravity_comp_ros.simulation.arms import gravity_torque, Payload, with_payload
import numpy as np

# Time between messages, and between their stamps, s.
PERIOD, STEP = 0.006, 0.2
# Rate of joint states of an arm that is guided by hand, Hz.
GUIDED_RATE = 50.0
# Torque error allowed in addition to that of the old model, N·m.
ALLOWED_ERROR = 1.0
# Rate limit of the torque, N·m/s, for motion that is sent faster than its stamps.
RATE = 10000.0
# Maximum torque change between two poses, N·m.
MAX_STEP = 20.0
PARAMETERS: dict[str, object] = {
    'ramp_time': 0.1, 'max_torque': '[176.0]', 'max_torque_rate': f'[{RATE}]',
    'stale_after': 10.0, 'stale_action': 'hold', 'settle_time': 0.0, 'diagnostics_rate': 20.0,
    'formulation': 'auto'}

Corruption = Callable[[FloatArray, np.random.Generator], FloatArray]


def healthy(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the unchanged effort."""
    return tau


class Player:
    """Moves the arm, sends its measurements, and checks the torques of the node."""

    def __init__(self, probe, model: GravityModel, payload: Payload | None = None,
                 seed: int = 0, test_arm: TestArm | None = None) -> None:
        self.probe, self.model = probe, model
        self.test_arm = test_arm or seven()
        self.joints = self.test_arm.arm.joints
        self.rng = np.random.default_rng(seed)
        self.t = 1000.0 + 100.0 * seed
        self.poses: dict[tuple[int, int], FloatArray] = {}
        self.wrong: list[str] = []
        self.checked = 0
        self.carry(payload)

    def carry(self, payload: Payload | None) -> None:
        """Attach a payload to the last link, or remove it."""
        bare = self.test_arm.arm
        self.arm = bare if payload is None else with_payload(bare, payload)

    def move(self, n: int, corrupt: Corruption = healthy, period: float = PERIOD,
             **change) -> None:
        """
        Send n joint states of slow motion.

        :param corrupt: returns the reported effort from the true torque.
        :param change: changes of each message: `velocity` (factor), `offset` (rad added to all
            positions), `scale` (of positions), `stamp`.
        """
        part = self.test_arm.motion(n * STEP, 1.0 / STEP, self.t)
        tau = gravity_torque(self.arm, part.q) + NOISE * self.rng.standard_normal(part.q.shape)
        effort = corrupt(tau, self.rng)
        due = time.monotonic()
        for k in range(n):
            t = self.t + STEP * k
            q = part.q[k]
            self.poses[int(t), round((t - int(t)) * 1e9)] = q
            sent = q * change.get('scale', 1.0) + change.get('offset', 0.0)
            self.probe.send(self.joints, change.get('stamp', t), sent,
                            part.qd[k] * change.get('velocity', 1.0), effort[k])
            due += period
            self.probe.spin(max(1e-4, due - time.monotonic()))
        self.t += STEP * n

    def error(self) -> float:
        """Return the error of the last torque at the last pose, N·m."""
        pose = list(self.poses.values())[-1]
        truth = gravity_torque(self.arm, pose[None])[0]
        return float(np.abs(np.array(self.probe.torques[-1].effort) - truth).max())

    def suspected_payloads(self) -> list[str]:
        """Return a list to which the text of each suspected payload is added from now on."""
        from diagnostic_msgs.msg import DiagnosticArray
        events: list[str] = []
        self.probe.create_subscription(
            DiagnosticArray, '/gravity_comp/payload_suspected',
            lambda message: events.append(message.status[0].message), 10)
        self.probe.spin(0.5)
        return events

    def jump(self, t: float) -> None:
        """Go to another part of the motion; torques published on the way are not checked."""
        self.t = t
        self.move(30)
        end = time.monotonic() + 20.0
        # On a busy machine the first torque still ramps up after many messages.
        while self.probe.report('feed-forward').message.startswith(RAMPING) and (
                time.monotonic() < end):
            self.move(10)
        self.probe.spin(0.3)
        self.probe.torques.clear()

    def guide(self, seconds: float) -> None:
        """Guide the arm by hand in real time: its effort is the last published torque."""
        part = self.test_arm.motion(seconds, GUIDED_RATE, self.t)
        due = time.monotonic()
        for k, t in enumerate(part.t):
            self.poses[int(t), round((t - int(t)) * 1e9)] = part.q[k]
            torques = self.probe.torques
            effort = np.array(torques[-1].effort) if torques else np.zeros(len(self.joints))
            self.probe.send(self.joints, t, part.q[k], part.qd[k],
                            effort + 0.02 * self.rng.standard_normal(len(self.joints)))
            due += 1.0 / GUIDED_RATE
            self.probe.spin(max(1e-4, due - time.monotonic()))
        self.t += seconds

    def finish_fits(self, seconds: float = 60.0) -> None:
        """Wait until no fit runs or is due, and all messages have been answered."""
        self.probe.spin(0.1)
        quiet = 0
        end = time.monotonic() + seconds
        while quiet < 3 and time.monotonic() < end:
            self.probe.report('learning')
            state = self.probe.values('learning').get('fit process')
            quiet = quiet + 1 if state == 'ready' else 0

    def check(self, what: str, ramps: bool = False) -> None:
        """
        Check each torque since the last call.

        Its error must not exceed that of the initial model by more than `ALLOWED_ERROR`.

        :param ramps: torque may ramp from or to zero.
        """
        last: FloatArray | None = None
        before = 0.0
        for message in self.probe.torques:
            tau = np.array(message.effort)
            stamp = message.header.stamp.sec, message.header.stamp.nanosec
            pose = self.poses.get(stamp)
            if not np.isfinite(tau).all() or np.abs(tau).max() > 176.0:
                self.wrong.append(f'{what}: {tau} is no torque')
            if pose is None:
                continue
            self.checked += 1
            truth = gravity_torque(self.arm, pose[None])[0]
            allowed = ALLOWED_ERROR + np.abs(self.model.predict_one(pose) - truth)
            # A ramping torque is between zero and the true torque.
            error = np.abs(tau - truth) if not ramps else np.maximum(
                np.abs(tau) - np.abs(truth), -np.sign(truth) * tau)
            if (error > allowed).any():
                k = int(np.argmax(error - allowed))
                self.wrong.append(f'{what}: {self.joints[k]} {tau[k]:.2f} N·m, truth '
                                  f'{truth[k]:.2f}, allowed {allowed[k]:.2f}')
            # Only the newest of waiting messages is answered.
            t = stamp[0] + 1e-9 * stamp[1]
            poses = max(1.0, (t - before) / STEP)
            if last is not None and np.abs(tau - last).max() > MAX_STEP * poses:
                self.wrong.append(f'{what}: a step of {np.abs(tau - last).max():.1f} N·m')
            last, before = tau, t
        self.probe.torques.clear()
        self.probe.commands.clear()

    def model_in_use(self) -> str:
        """Return the message of the status `model`."""
        return str(self.probe.report('model').message)
