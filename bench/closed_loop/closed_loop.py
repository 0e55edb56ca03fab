"""
Drift of an arm in MuJoCo that the torque of the running node supports, over DDS.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.closed_loop.closed_loop [--seeds 2]

A controller moves the arm slowly for 75 s without a load, while the node learns. Then 2 kg are
attached to the flange, `~/payload_changed` is called, and the arm moves slowly for 15 s and for 75
s. After each stage the arm is set at rest at random poses within the range of the motion, and
`~/gravity_torques` alone supports it for 5 s. Drift is the largest rotation of any joint in
degrees. The node has its default parameters except `unlimited_torque`. Friction of 1 N·m per joint
holds the arm, so only a larger torque error moves it.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable, Sequence
import sys
import time

from bench.closed_loop.arm import (
    BUILDS, builds_and_seeds, Controller, each, Load, MujocoArm, SlowPath, STEP)
from bench.shared.runner import Result, run
import numpy as np

RATE = 100.0
# Time for which the node's torque alone supports the arm, s.
SUPPORTED = 5.0
LOAD = Load(2.0)


class Rig:
    """An arm with its joint states, moved by a controller or supported by the node."""

    def __init__(self, probe, build: str, seed: int) -> None:
        self.probe, self.build, self.seed = probe, build, seed
        self.path = SlowPath.random(len(BUILDS[build]), seed)
        self.arm = MujocoArm(build, None, seed)
        self.control = Controller(len(self.arm.joints))
        self.stamp, self.begun = 0.0, time.monotonic()
        self.low = np.full(len(self.arm.joints), np.inf)
        self.high = -self.low
        self.supplied = np.zeros(len(self.arm.joints))

    def attach(self, load: Load) -> None:
        """Attach a load to the flange."""
        q = self.arm.q
        self.arm = MujocoArm(self.build, load, self.seed + 100)
        self.arm.place(q)

    def move(self, start: float, duration: float) -> None:
        """Follow the slow path from time `start`, in real time."""
        self._approach(self.path.at(start)[0])
        for k in range(round(duration * RATE)):
            self._simulate(lambda step, t=start + k / RATE: self.control.torque(
                self.arm, *self.path.at(t + step * STEP)))
            self.low = np.minimum(self.low, self.arm.q)
            self.high = np.maximum(self.high, self.arm.q)

    def drift(self, q: np.ndarray) -> float:
        """Return the drift in degrees from pose q with the node's torque as only support."""
        self._approach(q)
        drift, first = 0.0, self.arm.q
        for k in range(round(SUPPORTED * RATE)):
            tau = self.node_torque()
            self._simulate(lambda _, tau=tau: tau)
            drift = max(drift, float(np.abs(self.arm.q - first).max()))
            if drift > 2.0:
                break
        return float(np.degrees(drift))

    def node_torque(self) -> np.ndarray:
        """Return the last published torque."""
        torques = self.probe.torques
        if torques:
            self.supplied = np.array(torques[-1].effort)
            del torques[:-1]
        return self.supplied

    def _approach(self, q: np.ndarray) -> None:
        """Move to a pose, faster than the gate accepts for learning, and come to rest."""
        start = self.arm.q
        steps = max(50, round(float(np.abs(q - start).max()) / 0.4 * RATE))

        def goal(number: float) -> np.ndarray:
            share = min(1.0, number / steps)
            return start + share * share * (3.0 - 2.0 * share) * (q - start)

        for k in range(steps + 50):
            # A new goal in each step: steps of the goal at the message rate would be a torque
            # that the effort at the end of a message does not have.
            self._simulate(lambda step, k=k: self.control.torque(
                self.arm, goal(k + step * STEP * RATE), 0.0 * q))

    def _simulate(self, torque: Callable[[int], np.ndarray]) -> None:
        """Simulate until the next message with a torque per step, publish it, and wait."""
        for step in range(round(1.0 / (RATE * STEP))):
            tau = torque(step)
            self.arm.step(tau)
        self.stamp += 1.0 / RATE
        position, speed, effort = self.arm.measured(tau)
        self.probe.send(self.arm.joints, 1000.0 + self.stamp, position, speed, effort)
        remaining = self.begun + self.stamp - time.monotonic()
        self.probe.spin(max(remaining, 1e-3))


def measure(build: str, seed: int, poses: int) -> Result:
    """Return the drifts of one arm at each stage."""
    from bench.shared.ros_harness import running
    drifts: dict[str, list[float]] = {}
    with running({'unlimited_torque': True}) as (_, probe):
        rig = Rig(probe, build, seed)
        rng = np.random.default_rng([seed, 9])

        def stage(name: str) -> None:
            drifts[name] = [rig.drift(q) for q in rng.uniform(
                rig.low, rig.high, (poses, len(rig.low)))]

        rig.move(0.0, 75.0)
        stage('no load')
        rig.attach(LOAD)
        assert probe.call('payload_changed').success
        rig.move(75.0, 15.0)
        stage('2 kg, 15 s')
        rig.move(90.0, 60.0)
        stage('2 kg, 75 s')
    return {'build': build, 'drifts': drifts}


def options(parser: ArgumentParser) -> None:
    builds_and_seeds(parser)
    parser.set_defaults(seeds=[0, 1, 2])
    parser.add_argument('--poses', type=int, default=5)


def totals(results: Sequence[Result]) -> str:
    """Return median and maximum drift of each stage."""
    drifts: dict[str, list[float]] = {}
    for result in results:
        for stage, values in result['drifts'].items():
            drifts.setdefault(f'{result["build"]}, {stage}', []).extend(values)
    return '\n'.join(f'{title}: median {np.median(values):.2f}, worst {max(values):.2f} degrees'
                     for title, values in drifts.items())


if __name__ == '__main__':
    sys.exit(run(__doc__, options, lambda args: each(args, args.poses), measure,
                 lambda result: totals([result]), totals))
