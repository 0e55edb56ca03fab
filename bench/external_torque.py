#!/usr/bin/env python3
"""
External torque in MuJoCo: alarms in free motion, and pushes of known force at known links.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.external_torque [--seeds 11 12 13] [--minutes 20]

A controller moves an arm with friction slowly for 75 s, and a model is fitted. The same arm then
moves freely, with stops and at up to 0.26 rad/s, for some minutes with other noise. Then a force
pushes the centre of a random link in a random direction for 0.3 s every 2 s. Its size is such that
the largest torque of a joint is `--size` published standard deviations at its start, which is 1 ms
after a message. Everything passes through `external_torque`, as in the node. The options were
chosen with the seeds 1 to 3, the range of friction at rest with 38 and 39; other seeds judge. An
hour of motion takes three minutes.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
import tempfile

from bench.closed_loop.arm import Controller, MujocoArm, record, SlowPath, STEP, urdf
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


def fitted(build: str, seed: int) -> gc.Model:
    """Return the model of an arm's slow motion."""
    arm = MujocoArm(build, None, seed)
    recording = gc.Recording(record(arm, SlowPath.random(len(arm.joints), seed), 0.0, TRAINING))
    with tempfile.TemporaryDirectory() as folder:
        description = Path(folder) / 'arm.urdf'
        description.write_text(urdf(arm.links))
        return gc.fit(recording, urdf=description)


def free(model: gc.Model, build: str, seed: int, rate: float,
         minutes: float) -> tuple[int, float, np.ndarray]:
    """Return the alarms of free motion, its known hours, and the RMS of torque / std (N,)."""
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


def main() -> None:
    """Print alarms and times of detection."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--seeds', type=int, nargs='+', default=[11, 12, 13])
    parser.add_argument('--builds', nargs='+', default=['six', 'seven'])
    parser.add_argument('--rate', type=float, default=100.0, help='Hz')
    parser.add_argument('--minutes', type=float, default=20.0, help='free motion of each arm')
    parser.add_argument('--pushes', type=int, default=50, help='of each arm')
    parser.add_argument('--size', type=float, default=5.0, help='standard deviations')
    args = parser.parse_args()
    alarms, hours, times, forces = 0, 0.0, [], []
    for build in args.builds:
        for seed in args.seeds:
            model = fitted(build, seed)
            count, known, ratio = free(model, build, seed, args.rate, args.minutes)
            detected = pushes(model, build, seed, args.rate, args.pushes, args.size)
            late = np.array([time for time, _ in detected])
            std = np.median([push.std for _, push in detected], axis=0)
            print(f'{build} {seed}: {count} alarms in {60 * known:.1f} min, torque / std RMS '
                  f'{ratio[0].max():.2f}, max {ratio[1].max():.2f}; std '
                  f'{std.min():.2f} to {std.max():.2f} N·m; {len(late)} pushes, '
                  f'{(late <= LIMIT).sum()} within {1e3 * LIMIT:.0f} ms, '
                  f'median {1e3 * np.median(late):.0f} ms', flush=True)
            alarms, hours = alarms + count, hours + known
            times += late.tolist()
            forces += [float(np.linalg.norm(push.force)) for _, push in detected]
    delays = np.array(times)
    print(f'{alarms} alarms in {hours:.2f} h; {len(delays)} pushes of {args.size:g} std '
          f'({min(forces):.1f} to {max(forces):.0f} N, median {np.median(forces):.1f} N): '
          f'{(delays <= LIMIT).sum()} within {1e3 * LIMIT:.0f} ms, '
          f'{np.isinf(delays).sum()} missed, time median {1e3 * np.median(delays):.0f}, '
          f'95 % {1e3 * np.quantile(delays, 0.95):.0f} ms')


if __name__ == '__main__':
    main()
