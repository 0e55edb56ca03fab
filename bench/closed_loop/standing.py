"""
Faults of the input of the running node, whose torque supports an arm in MuJoCo.

    python3 -m bench.closed_loop.standing [--only TEXT] [--axes]

The node is a separate process. Simulation and node communicate over DDS in lock-step: every 20 ms
of simulated time a joint state, `/clock`, and the torque in reply. Each fault of the effort begins
with `~/payload_changed`: the arm moves slowly for 30 s under its position controller plus the
node's torque, with broken effort. Then the controller is switched off, and the torque of the node
alone supports the arm for 4 s. Faults of the input begin while it is supported. The arm is at rest
if no joint moves by more than 0.05 rad. A fault passes if the arm stays at rest or a status warned
before it moved, and no model of broken effort is in use at the end. Real payloads of 1 and 3 kg
must be learned, and the arm must stay at rest.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import sys
import tempfile
import time

from bench.closed_loop.arm import Controller, Load, MujocoArm, SEVEN, SlowPath, STEP, urdf
from bench.closed_loop.open_loop import record
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.model_file import save_model
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
# Simulation steps per joint state.
STEPS = 20
# Maximum motion of a joint of an arm at rest, rad.
MAX_MOTION = 0.05
# Time of motion for learning, and of support by the node alone, s.
MOVING, SUPPORTED = 30.0, 4.0
WARN = 1
WATCHED = ('learning', 'input', 'feed-forward', 'clock', 'model')
Corruption = Callable[[FloatArray], FloatArray]


class Rig:
    """The simulated arm, its controller, and its communication with the node."""

    def __init__(self, probe, clock, build: str, seed: int) -> None:
        from rosgraph_msgs.msg import Clock
        self.probe, self._clock, self._tick = probe, clock, Clock()
        self.build, self.seed = build, seed
        self.t = 100.0
        self.path = SlowPath.random(len(SEVEN), seed)
        self.control = Controller(len(SEVEN))
        self.feed = np.zeros(len(SEVEN))
        self.rng = np.random.default_rng(seed)
        self.warned: tuple[float, str] | None = None
        self.accepted = False
        self.carry(None, 75.0)

    def carry(self, load: Load | None, at: float) -> None:
        """Replace the arm by one with this load, at a time of the path."""
        self.arm = MujocoArm(self.build, load, self.seed + 7)
        self.begun = at
        self.arm.place(self.path.at(at)[0])

    def watch(self) -> None:
        """Start to record warnings."""
        self.probe.status.clear()
        self.warned, self.accepted = None, False

    def goal(self, moves: bool) -> tuple[FloatArray, FloatArray]:
        q, qd = self.path.at(self.begun)
        return (q, qd) if moves else (q, 0.0 * qd)

    def run(self, seconds: float, moves: bool, controlled: bool, corrupt: Corruption | None = None,
            send: Callable[..., None] | None = None) -> float:
        """
        Simulate some seconds; return the largest distance of a joint from its start, rad.

        :param moves: whether the arm follows the path.
        :param controlled: whether the controller is on.
        :param corrupt: returns the reported effort from the measured one.
        :param send: sends the joint state; None for an unchanged one.
        """
        start, distance = self.arm.q, 0.0
        for _ in range(round(seconds / (STEPS * STEP))):
            self._exchange(corrupt, send)
            for _ in range(STEPS):
                if moves:
                    self.begun += STEP
                tau = self.feed.copy()
                if controlled:
                    tau += self.control.torque(self.arm, *self.goal(moves))
                self.tau = tau
                self.arm.step(tau)
                self.t += STEP
            if moves:
                self._wait_for_fits()
            if not moves:
                distance = max(distance, float(np.abs(self.arm.q - start).max()))
                if distance > MAX_MOTION and not controlled:
                    break
        return distance

    def _exchange(self, corrupt: Corruption | None, send: Callable[..., None] | None) -> None:
        """Send the state of the arm, and receive the torque in reply."""
        probe = self.probe
        self._tick.clock.sec = int(self.t)
        self._tick.clock.nanosec = min(int((self.t % 1.0) * 1e9), 999_999_999)
        self._clock.publish(self._tick)
        q, qd, tau = self.arm.measured(getattr(self, 'tau', self.feed))
        tau = tau if corrupt is None else corrupt(tau)
        count = len(probe.torques)
        if send is None:
            probe.send(self.arm.joints, self.t, q, qd, tau)
        else:
            send(probe, self.arm.joints, self.t, q, qd, tau)
        end = time.monotonic() + (0.05 if send is None else 0.01)
        while len(probe.torques) == count and time.monotonic() < end:
            probe.loop.spin_once(timeout_sec=0.005)
        if probe.torques:
            self.feed = np.array(probe.torques[-1].effort)
            del probe.torques[:-1], probe.commands[:-1]
        self._record_warnings()

    def _wait_for_fits(self) -> None:
        """Wait for a running fit, so that its duration in simulated time is 0."""
        end = time.monotonic() + 60.0
        while self.probe.values('learning').get('fit process') == 'fitting' \
                and time.monotonic() < end:
            self.probe.spin(0.01)

    def _record_warnings(self) -> None:
        self.accepted = self.accepted or ' in epoch ' in self.probe.status['model'].message
        if self.warned is None:
            for name in WATCHED:
                status = self.probe.status[name]
                if status.name and status.level[0] >= WARN:
                    self.warned = self.t, f'{name}: {status.message}'
                    return

    def finish_fits(self, corrupt: Corruption | None) -> None:
        """Rest under the controller until no fit runs and warnings have been published."""
        quiet, end = 0, time.monotonic() + 60.0
        while quiet < 20 and time.monotonic() < end:
            self.run(0.05, False, True, corrupt)
            self.probe.spin(0.005)
            state = self.probe.values('learning').get('fit process')
            quiet = quiet + 1 if state == 'ready' else 0


def corrupted(kind: Callable, rig: Rig) -> Corruption:
    """Return broken effort sample by sample; a frozen sensor repeats the first sample."""
    path = np.array([rig.path.at(t)[0] for t in np.arange(75.0, 75.0 + MOVING, 0.5)])
    torque = rig.arm.gravity(path)
    largest = torque[np.argmax(np.abs(torque).max(axis=1))]
    first: list[FloatArray] = []

    def corrupt(tau: FloatArray) -> FloatArray:
        if not first:
            first.append(tau)
        return np.asarray(kind(np.array([first[0], largest, tau]), rig.rng)[-1])
    return corrupt


def effort_fault(rig: Rig, kind: Callable | None, load: Load | None = None) -> tuple[float, str]:
    """Learn from broken or true effort; return the motion under support, and the model in use."""
    rig.carry(load, 75.0)
    rig.run(3.0, False, True)
    rig.watch()
    corrupt = None if kind is None else corrupted(kind, rig)
    rig.probe.call('payload_changed')
    rig.run(MOVING, True, True, corrupt)
    rig.finish_fits(corrupt)
    moved = rig.run(SUPPORTED, False, False, corrupt)
    return moved, str(rig.probe.status['model'].message)


def input_fault(rig: Rig, send: Callable[..., None]) -> tuple[float, str]:
    """Inject a fault of the input while the node supports the arm; return as `effort_fault`."""
    rig.carry(None, 80.0)
    rig.run(3.0, False, True)
    rig.run(1.0, False, False)
    rig.watch()
    return rig.run(SUPPORTED, False, False, None, send), str(rig.probe.status['model'].message)


def nothing(probe, names, t, q, qd, tau) -> None:
    """Send no joint state at all."""


def changed(**change: object) -> Callable[..., None]:
    """Return a sender that replaces parts of each message: `q`, `qd`, `tau`, `t`, `names`."""
    def send(probe, names, t, q, qd, tau) -> None:
        fields = {'names': names, 't': t, 'q': q, 'qd': qd, 'tau': tau}
        for name, function in change.items():
            fields[name] = function(fields[name])  # type: ignore[operator]
        probe.send(**fields)
    return send


INPUT = {
    'no joint states': nothing,
    'angles in degrees': changed(q=np.degrees),
    'positions not finite': changed(q=lambda q: np.full_like(q, np.nan)),
    'stamps of 0': changed(t=lambda t: 0.0),
    'stamps that go back': changed(t=lambda t: 50.0 + 0.0 * t),
    'a joint missing': changed(names=lambda names: [*names[:-1], 'other']),
    'drives report nothing': changed(tau=lambda tau: 0.0 * tau),
    'effort not finite': changed(tau=lambda tau: np.full_like(tau, np.nan)),
    'velocity of 1 rad/s at rest': changed(qd=lambda qd: qd + 1.0)}


def faults() -> dict[str, Callable[[Rig], tuple[float, str]]]:
    """Return all faults by name; the first ones are real payloads, which must be learned."""
    from bench.shared.broken_effort import KINDS
    result: dict[str, Callable[[Rig], tuple[float, str]]] = {
        f'real payload of {mass:g} kg': lambda rig, mass=mass: effort_fault(  # type: ignore[misc]
            rig, None, Load(mass)) for mass in (1.0, 3.0)}
    for name, kind in KINDS.items():
        result[name] = lambda rig, kind=kind: effort_fault(rig, kind)  # type: ignore[misc]
    for name, send in INPUT.items():
        result[name] = lambda rig, send=send: input_fault(rig, send)  # type: ignore[misc]
    return result


def run_fault(name: str, play: Callable, path: Path, description: str | None, seed: int) -> bool:
    """Inject one fault into a new node; return whether it passed."""
    from bench.node_faults.client import describe
    from bench.shared.ros_harness import running
    from rosgraph_msgs.msg import Clock
    parameters = {'model_file': path, 'max_torque': '[200.0]', 'settle_time': 0.0,
                  'diagnostics_rate': 20.0, 'use_sim_time': True, 'max_age': 0.3,
                  'joints': '[' + ', '.join(f'joint_{k + 1}' for k in range(len(SEVEN))) + ']'}
    begun = time.monotonic()
    with running(parameters) as (node, probe):
        clock = probe.create_publisher(Clock, '/clock', 10)
        probe.until(lambda: clock.get_subscription_count() > 0)
        if description is not None:
            describe(probe, description)
        rig = Rig(probe, clock, 'seven', seed)
        moved, model = play(rig)
        alive = node.process.poll() is None
    stays = moved <= MAX_MOTION
    is_real = name.startswith('real')
    passed = alive and (stays or (rig.warned is not None and not is_real))
    in_use = ' in epoch ' in model
    passed = passed and in_use == is_real
    if rig.accepted and not in_use:
        model = f'a model was in use temporarily; {model}'
    warned = '' if rig.warned is None else f'; warned: {rig.warned[1][:110]}'
    print(f'{"ok    " if passed else "FAILED"} {time.monotonic() - begun:5.1f} s  {name}: '
          f'{"stays" if stays else "moves"}, {moved:.4f} rad; {model[:60]}{warned}', flush=True)
    return passed


def main() -> int:
    """Inject all faults, and print a line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--only', default='')
    parser.add_argument('--axes', action='store_true', help='the axes are known (URDF)')
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'model.json'
        bare = MujocoArm('seven', None, args.seed)
        samples = slow_samples(record(bare, SlowPath.random(len(SEVEN), args.seed), 0.0, 75.0))
        save_model(path, fit(samples.samples, FitOptions(formulation='auto')).model)
        selected = {name: play for name, play in faults().items() if args.only in name}
        failed = [name for name, play in selected.items() if not run_fault(
            name, play, path, urdf(SEVEN) if args.axes else None, args.seed)]
    print(f'{len(selected)} faults, {len(failed)} failures {failed or ""}')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
