"""
Drift of an arm in MuJoCo that the torque of the running node supports, over DDS.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.closed_loop.closed_loop [--seeds 3] [--first 2]

A controller moves the arm slowly for 75 s without a load, while the node learns. Then 2 kg are
attached to the flange, `~/payload_changed` is called, and the arm moves slowly for 15 s and for 75
s. After each stage the arm is set at rest at random poses within the range of the motion, and
`~/gravity_torques` alone supports it for 5 s. Drift is the largest rotation of any joint in
degrees. The node has its default parameters except `unlimited_torque`. Friction of 1 N·m per joint
holds the arm, so only a larger torque error moves it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import time

from bench.closed_loop.arm import BUILDS, Controller, Load, MujocoArm, SlowPath, STEP
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


def measure(build: str, seed: int, poses: int) -> dict[str, list[float]]:
    """Return the drifts of one arm at each stage."""
    from bench.shared.ros_harness import running
    drifts: dict[str, list[float]] = {}
    with running({'unlimited_torque': True}) as (_, probe):
        rig = Rig(probe, build, seed)
        rng = np.random.default_rng([seed, 9])

        def stage(name: str) -> None:
            start = rng.uniform(rig.low, rig.high, (poses, len(rig.low)))
            before = probe.status['model'].message
            drifts[name] = [rig.drift(q) for q in start]
            size = np.sqrt((rig.arm.gravity(start) ** 2).mean())
            print(f'  {build} {seed} {name}: drift {np.round(drifts[name], 2)} degrees, gravity '
                  f'{size:.1f} N·m; {before[:90]}; '
                  f'{probe.status["learning"].message[:150]} '
                  f'{probe.values("learning").get("last fit", "")[:300]}', flush=True)

        rig.move(0.0, 75.0)
        stage('no load')
        rig.attach(LOAD)
        assert probe.call('payload_changed').success
        rig.move(75.0, 15.0)
        stage('2 kg, 15 s')
        rig.move(90.0, 60.0)
        stage('2 kg, 75 s')
    return drifts


def main() -> None:
    """Print median and maximum drift of each stage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--poses', type=int, default=5)
    parser.add_argument('--build', nargs='+', default=list(BUILDS))
    parser.add_argument('--first', type=int, default=0, help='first seed')
    args = parser.parse_args()
    for build in args.build:
        rows = [measure(build, seed, args.poses) for seed in range(args.first, args.seeds)]
        for stage in rows[0]:
            drifts = np.concatenate([row[stage] for row in rows])
            print(f'{build}, {stage}: median {np.median(drifts):.2f}, worst {drifts.max():.2f} '
                  'degrees', flush=True)


if __name__ == '__main__':
    main()
