"""
External torque in MuJoCo: alarms in free motion, and pushes of known force at known links.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.external_torque [--seeds 11-13] [--minutes 20]

A controller moves an arm with friction slowly for 75 s, and a model is fitted. The same arm then
moves freely, with stops and at up to 0.26 rad/s, for some minutes with other noise. Then a force
pushes the centre of a random link in a random direction for 0.3 s every 2 s. Its size is such that
the largest torque of a joint is `--size` published standard deviations at its start, which is 1 ms
after a message. Everything passes through `external_torque`, as in the node. The options were
chosen with the seeds 1 to 3, the range of friction at rest with 38 and 39; other seeds judge. An
hour of motion takes three minutes.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
import sys
import tempfile
from typing import Any

from bench.closed_loop.arm import (
    builds_and_seeds, Controller, each, MujocoArm, record, SlowPath, STEP, urdf)
from bench.shared.runner import Result, run
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.evaluation.external_torque import external_torque, ExternalTorqueObserver
import mujoco
import numpy as np

TRAINING, PUSH, EVERY = 75.0, 0.3, 2.0
# Time by which a push must be detected, s.
LIMIT = 0.05


def stop_and_go(path: SlowPath, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return pose and speed on a path whose pace changes between zero and twice its own."""
    pace, omega = 1.0 - np.cos(0.7 * t), 0.7
    q, qd = path.at(TRAINING + t - np.sin(omega * t) / omega)
    return q, pace * qd


@dataclass
class Push:
    """A force (3,) in N on a body that begins at `start` in s, its torques (N,) in N·m."""

    start: float
    body: int
    force: np.ndarray
    torque: np.ndarray
    std: np.ndarray


class Pushed:
    """An arm that moves freely, and is pushed now and then."""

    def __init__(self, build: str, seed: int, rate: float) -> None:
        self.path = SlowPath.random(len(MujocoArm(build).joints), seed)
        self.arm = MujocoArm(build, None, seed + 1000)
        self.control, self.every = Controller(len(self.arm.joints)), round(1.0 / (rate * STEP))
        self.rng = np.random.default_rng([seed, 77])
        self.arm.place(stop_and_go(self.path, 0.0)[0])
        self.step = -1000

    def next(self, push: Push | None = None) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Simulate until the next message and return it: t, q, qd, tau."""
        while True:
            t = max(self.step, 0) * STEP
            self.arm.data.xfrc_applied[:] = 0.0
            if push is not None:
                self.arm.data.xfrc_applied[push.body, :3] = push.force
            tau = self.control.torque(self.arm, *stop_and_go(self.path, t))
            message = self.arm.measured(tau) if self.step % self.every == 0 else None
            self.arm.step(tau)
            self.step += 1
            if self.step > 0 and message is not None:
                return (t, *message)

    def drawn(self, std: np.ndarray, size: float) -> Push:
        """Return a push that begins now, of `size` standard deviations."""
        model, data = self.arm.model, self.arm.data
        body = model.nbody - 1 - int(self.rng.integers(4))
        force = self.rng.normal(size=3)
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
        torque = jacobian.T @ force
        scale = size / np.abs(torque / std).max()
        return Push(self.step * STEP, body, scale * force, scale * torque, std)


def fitted(build: str, seed: int, seconds: float = TRAINING) -> gc.Model:
    """Return the model of some seconds of an arm's slow motion."""
    arm = MujocoArm(build, None, seed)
    recording = gc.Recording(record(arm, SlowPath.random(len(arm.joints), seed), 0.0, seconds))
    with tempfile.TemporaryDirectory() as folder:
        description = Path(folder) / 'arm.urdf'
        description.write_text(urdf(arm.links))
        return gc.fit(recording, urdf=description)


def free(model: gc.Model, build: str, seed: int, rate: float,
         minutes: float) -> tuple[int, float, np.ndarray]:
    """Return the alarms of free motion, its known hours, and torque / std (2, N): RMS, maximum."""
    pushed = Pushed(build, seed, rate)
    rows = [pushed.next() for _ in range(round(60.0 * minutes * rate))]
    t, q, qd, tau = (np.array(part) for part in zip(*rows))
    result = external_torque(model.gravity, JointSamples.single_run(
        pushed.arm.joints, t, q, qd, tau))
    known = np.isfinite(result.std).all(axis=1)
    alarm = result.significant.any(axis=1)
    ratio = (result.torque / result.std)[known]
    return (int((alarm[1:] & ~alarm[:-1]).sum()), known.mean() * minutes / 60.0,
            np.array([np.sqrt((ratio ** 2).mean(axis=0)), np.abs(ratio).max(axis=0)]))


def pushes(model: gc.Model, build: str, seed: int, rate: float, count: int,
           size: float) -> list[tuple[float, Push]]:
    """Return the time from each push to its detection in s, infinite for none."""
    pushed, results = Pushed(build, seed, rate), []
    observer = ExternalTorqueObserver(model.gravity)
    now = None
    while len(results) < count:
        push, delay = None, np.inf
        end = pushed.step + round(EVERY / STEP)
        while pushed.step < end:
            message = pushed.next(push)
            if push is not None and message[0] >= push.start + PUSH:
                results.append((delay, push))
                push, end = None, pushed.step + round(0.5 / STEP)
            now = observer.add(*message) or now
            if push is not None and now.significant.any():
                delay = min(delay, message[0] - push.start)
            if (push is None and end - pushed.step <= round(2 * PUSH / STEP) + pushed.every
                    and end - pushed.step > round(0.5 / STEP)
                    and now is not None and np.isfinite(now.std).all()):
                push, delay = pushed.drawn(now.std, size), np.inf
    return results


def measured(build: str, seed: int, rate: float, minutes: float, count: int,
             size: float) -> Result:
    """Return alarms in free motion, and the times of detection of pushes, of one arm."""
    model = fitted(build, seed)
    alarms, known, ratio = free(model, build, seed, rate, minutes)
    detected = pushes(model, build, seed, rate, count, size)
    std = np.median([push.std for _, push in detected], axis=0)
    return {'alarms': alarms, 'hours': known, 'ratio': ratio.max(axis=1).tolist(),
            'std': [float(std.min()), float(std.max())], 'times': [time for time, _ in detected],
            'forces': [float(np.linalg.norm(push.force)) for _, push in detected]}


def options(parser: ArgumentParser) -> None:
    builds_and_seeds(parser)
    parser.add_argument('--rate', type=float, default=100.0, help='Hz')
    parser.add_argument('--minutes', type=float, default=20.0, help='free motion of each arm')
    parser.add_argument('--pushes', type=int, default=50, help='of each arm')
    parser.add_argument('--size', type=float, default=5.0, help='standard deviations')


def cases(args: Namespace) -> dict[str, tuple[Any, ...]]:
    return each(args, args.rate, args.minutes, args.pushes, args.size)


def line(one: Result) -> str:
    (rms, largest), (low, high) = one['ratio'], one['std']
    return (f'torque / std RMS {rms:.2f}, max {largest:.2f}; std {low:.2f} to {high:.2f} N·m; '
            f'{totals([one])}')


def totals(results: Sequence[Result]) -> str:
    times, forces = (np.array([x for one in results for x in one[key]])
                     for key in ('times', 'forces'))
    return (f'{sum(one["alarms"] for one in results)} alarms in '
            f'{sum(one["hours"] for one in results):.2f} h; {len(times)} pushes of '
            f'{forces.min():.1f} to {forces.max():.0f} N, median {np.median(forces):.1f} N: '
            f'{(times <= LIMIT).sum()} within {1e3 * LIMIT:.0f} ms, {np.isinf(times).sum()} '
            f'missed, time median {1e3 * np.median(times):.0f}, 95 % '
            f'{1e3 * np.quantile(times, 0.95):.0f} ms')


if __name__ == '__main__':
    sys.exit(run(__doc__, options, cases, measured, line, totals))
