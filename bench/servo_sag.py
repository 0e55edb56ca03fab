"""
Sag of a position-controlled arm in MuJoCo without and with `~/position_offset`.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.servo_sag [--seeds 11-13] [--poses 10]

The servos have a random stiffness of 100 to 400 N·m/rad, no integral part, and 1 N·m of friction.
They follow a slow path for 75 s; gravity and then the stiffness are learned from that recording.
At random poses the arm then holds a goal for 2 s without and 3 s with the offset of the node's
core, which receives joint states at 100 Hz. Friction holds a joint on the side from which it
comes, so that each goal is approached slowly from both sides. Sag is goal minus position, the mean
of both sides, RMS over poses and joints; half their difference is what friction holds.
"""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path
import sys
import tempfile

from bench.closed_loop.arm import (
    builds_and_seeds, Controller, each, MujocoArm, SlowPath, STEP, urdf)
from bench.shared.node_messages import joint_state
from bench.shared.runner import extremes, figures, Result, run
import gravity_comp_ros as gc
from gravity_comp_ros.calibration.servo_stiffness import servo_stiffness
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.outputs import position_offset
from gravity_comp_ros.node.parameters import Parameters
import numpy as np

EVERY = 10
# Distance in rad from which a goal is approached, and the time in s.
APPROACH, SLOWLY = 0.05, 1.0
# Parameter `max_position_offset`, rad: the softest servos sag by 22 degrees.
LARGEST = 0.5


class Servos:
    """An arm with servos; `offset` (N,) in rad is added to the goals."""

    def __init__(self, build: str, seed: int) -> None:
        self.arm = MujocoArm(build, None, seed)
        n = len(self.arm.joints)
        self.path, self.rng = SlowPath.random(n, seed), np.random.default_rng([seed, 8])
        self.control = Controller(n)
        self.control.kp = self.rng.uniform(100.0, 400.0, n)
        self.control.kd = 0.1 * self.control.kp
        self.offset, self.step = np.zeros(n), 0
        self.arm.place(self.path.at(0.0)[0])

    def next(self, goal: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, ...]:
        """Simulate until the next message, at 100 Hz; return position, speed and effort."""
        for _ in range(EVERY):
            tau = self.control.torque(self.arm, goal + self.offset, speed)
            self.arm.step(tau)
        self.step += EVERY
        return self.arm.measured(tau)

    def record(self, duration: float) -> tuple[JointSamples, np.ndarray]:
        """Return a recording of slow motion and its goals (M, N)."""
        rows, goals = [], []
        for k in range(-100, round(duration / (STEP * EVERY))):
            goal, speed = self.path.at(max(k, 0) * STEP * EVERY)
            measured = self.next(goal, speed if k >= 0 else 0.0 * speed)
            if k >= 0:
                rows.append((k * STEP * EVERY, *measured))
                goals.append(goal)
        t, q, qd, tau = (np.array(part) for part in zip(*rows))
        return JointSamples.single_run(self.arm.joints, t, q, qd, tau), np.array(goals)

    def sag(self, goal: np.ndarray, seconds: float, core: NodeCore | None = None,
            stiffness: np.ndarray | None = None) -> np.ndarray:
        """
        Return goal minus position (2, N) after some seconds at a goal, from either side.

        With a core the offset of the node is added to the goals.
        """
        return np.array([self._error(goal, side * APPROACH, seconds, core, stiffness)
                         for side in (-1.0, 1.0)])

    def _error(self, goal: np.ndarray, start: float, seconds: float, core: NodeCore | None,
               stiffness: np.ndarray | None) -> np.ndarray:
        for k in range(round((SLOWLY + seconds) / (STEP * EVERY))):
            rest = max(1.0 - k * STEP * EVERY / SLOWLY, 0.0)
            measured = self.next(goal + start * rest, np.full_like(
                goal, -start / SLOWLY * (rest > 0.0)))
            if core is not None and stiffness is not None:
                t = 10.0 + self.step * STEP
                reading = core.read(joint_state(self.arm.joints, t, *measured), t)
                tau = None if reading is None else core.arm.torque(t, reading)
                if tau is not None:
                    self.offset = position_offset(tau, stiffness, LARGEST)
        return goal - self.arm.q


def measure(build: str, seed: int, poses: int) -> Result:
    """Return the figures of one arm: sag in degrees, and stiffness."""
    servos = Servos(build, seed)
    samples, goals = servos.record(75.0)
    recording = gc.Recording(samples)
    slow = recording.slow
    with tempfile.TemporaryDirectory() as folder:
        description, file = Path(folder) / 'arm.urdf', Path(folder) / 'arm.json'
        description.write_text(urdf(servos.arm.links))
        model = gc.fit(recording, urdf=description).gravity
        save_model(file, model)
        result = servo_stiffness(model, slow, goals[np.searchsorted(samples.t, slow.t - 1e-6)])
        # Joints without a stiffness carry hardly any torque, and get no offset.
        stiffness = np.array([result.stiffness[joint].value if joint in result.stiffness else 1e6
                              for joint in model.joints])
        core = NodeCore(Parameters(model_file=str(file), unlimited_torque=True,
                                   servo_stiffness=tuple(stiffness)), 'joint_states', 0.0)
    errors = []
    for goal in servos.rng.uniform(samples.q.min(axis=0), samples.q.max(axis=0),
                                   (poses, samples.n_joints)):
        servos.offset = 0.0 * goal
        errors.append((servos.sag(goal, 2.0), servos.sag(goal, 3.0, core, stiffness)))
    # Sides of the goal, with the offset and without (2, 2, P, N).
    below, above = np.array(errors).transpose(2, 1, 0, 3)
    (before, after), known = 0.5 * (below + above), stiffness < 1e6
    return {'sag': rms(before), 'with offset': rms(after), 'worst': float(
                np.degrees(np.abs(after).max())), 'friction holds': rms(0.5 * (above - below)[1]),
            'falls by %': 100.0 * (1.0 - rms(after) / rms(before)),
            'stiffness of': int(known.sum()), 'worst error %': 100.0 * float(
                np.abs(stiffness / servos.control.kp - 1.0)[known].max())}


def rms(error: np.ndarray) -> float:
    """Return the RMS of an error in rad, in degrees."""
    return float(np.degrees(np.sqrt((error ** 2).mean())))


def options(parser: ArgumentParser) -> None:
    builds_and_seeds(parser)
    parser.add_argument('--poses', type=int, default=10)


if __name__ == '__main__':
    sys.exit(run(__doc__, options, lambda args: each(args, args.poses), measure, figures,
                 extremes))
