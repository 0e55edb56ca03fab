"""Faults by name: the input of the node, and its required reaction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import time

from bench.node_faults.client import healthy, Player
from bench.shared.broken_effort import Break, intermittent_brake, KINDS
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Payload
import numpy as np

LENGTHS = (60, 120, 320)
MASSES = (0.3, 0.5, 1.0, 2.0, 3.0, 5.0)


@dataclass(frozen=True)
class Fault:
    """
    One fault: `play` injects it and returns the error in the node's reaction, empty if none.

    `parameters` are additional parameters of the node; faults with equal ones share a process.
    """

    name: str
    play: Callable[[Player], str]
    parameters: Mapping[str, object]
    ramps: bool = False


def broken(kind: str, n: int, seed: int) -> Fault:
    """Return broken effort for n samples after a payload change."""
    def play(player: Player) -> str:
        player.rng = np.random.default_rng(100 + seed)
        player.jump(2000.0 + 137.0 * seed)
        player.carry(Payload(2.0))
        before = player.model_in_use()
        player.probe.call('payload_changed')
        for part in np.diff([0, *(m for m in (60, 120, 220, 320) if m <= n)]):
            player.move(int(part), KINDS[kind])
            player.finish_fits()
        # A wrong model in use would show now, with correct effort.
        player.move(20)
        player.finish_fits()
        after = player.model_in_use()
        return '' if before == after or 'epoch' not in after else f'model accepted: {after}'
    return Fault(f'{kind}, {n} samples, seed {seed}', play, {})


def random_payload(seed: int, is_off_axis: bool) -> Payload:
    """Return a payload of 0.3 to 5 kg."""
    rng = np.random.default_rng(seed)
    side = rng.uniform(-0.15, 0.15, 2) if is_off_axis else (0.0, 0.0)
    return Payload(MASSES[seed % len(MASSES)], (*side, rng.uniform(0.05, 0.2)))


def real(seed: int, is_off_axis: bool, corrupt: Break = healthy) -> Fault:
    """Return a real payload, which must be learned within 20 s of motion."""
    payload = random_payload(seed, is_off_axis)
    centre = ', '.join(f'{x:.2f}' for x in payload.com)

    def play(player: Player) -> str:
        player.rng = np.random.default_rng(300 + seed)
        player.jump(4000.0 + 53.0 * seed)
        player.carry(payload)
        player.probe.call('payload_changed')
        before = player.model_in_use()
        for _ in range(2):
            player.move(50, corrupt)
            player.finish_fits()
        after = player.model_in_use()
        message = player.probe.status['learning'].message
        if after == before:
            return f'no model: {message}'
        if corrupt is not healthy and 'outliers' not in message:
            return f'outliers are not reported: {message}'
        return ''
    what = 'real payload' if corrupt is healthy else 'intermittent brake, payload'
    return Fault(f'{what} of {payload.mass:g} kg at {centre} m, seed {seed}', play, {})


def contacts(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return effort with a push of up to three seconds, about every half minute."""
    effort, k = tau.copy(), int(rng.integers(20, 60))
    while k < len(effort):
        push = rng.uniform(1.0, 10.0) * rng.standard_normal(tau.shape[1])
        effort[k:k + int(rng.integers(2, 16))] += push
        k += int(rng.integers(100, 200))
    return effort


def unannounced(mass: float) -> Fault:
    """Return an unannounced payload, which must be suspected and not learned."""
    def play(player: Player) -> str:
        events = player.suspected_payloads()
        player.jump(7000.0)
        before = player.model_in_use()
        player.move(80, contacts)
        player.finish_fits()
        if events:
            return f'false alarm: {events[0]}'
        player.carry(Payload(mass, (0.05, 0.0, 0.1)))
        for k in range(15):
            player.move(10)
            player.finish_fits()
            if events:
                print(f'       {mass:g} kg suspected after {2 * k + 2} s of motion')
                break
        if player.model_in_use() != before:
            return 'a model was accepted'
        return '' if events and 'another payload' in events[0] else 'not suspected'
    return Fault(f'an unannounced payload of {mass:g} kg', play, {})


def contacts_only(minutes: float) -> Fault:
    """Return motion with contacts, in which no payload must be suspected."""
    def play(player: Player) -> str:
        events = player.suspected_payloads()
        player.jump(9000.0)
        player.rng = np.random.default_rng(9)
        for _ in range(round(minutes)):
            player.move(300, contacts)
            player.finish_fits()
        return f'{len(events)} false alarms, {events[0]}' if events else ''
    return Fault(f'{minutes:g} minutes of motion with contacts', play, {})


def pause(seconds: float, action: str) -> Fault:
    """Return input that stops, and returns with the arm at another pose."""
    def play(player: Player) -> str:
        player.jump(6000.0)
        player.move(60)
        player.probe.spin(seconds)
        before = np.array(player.probe.torques[-1].effort)
        # Another pose, with 20 s of motion between.
        player.t += 20.0
        count = len(player.probe.torques)
        player.move(100)
        steps = np.abs(np.diff([before, *(message.effort for message in
                                          player.probe.torques[count:])], axis=0))
        # Torque lags the pose, so only its steps are checked.
        player.probe.torques.clear()
        # Twice the step at 500 N·m/s and up to 15 ms between messages on a busy machine; only the
        # newest of waiting messages is answered.
        allowed = 500.0 * 2.0 * 0.015 * max(1.0, 100.0 / len(steps))
        return '' if steps.max() <= allowed else f'a step of {steps.max():.1f} N·m'
    return Fault(f'{seconds:g} s without input, {action}', play,
                 {'stale_after': 0.2, 'stale_action': action, 'hold_time': 0.1, 'fade_time': 0.2,
                  'max_torque_rate': '[500.0]', 'ramp_time': 0.5}, ramps=True)


def silent(name: str, expected: str, status: str, parameters: Mapping[str, object],
           **change) -> Fault:
    """Return messages on which no torque must be published."""
    def play(player: Player) -> str:
        player.finish_fits()
        player.probe.torques.clear()
        player.move(40, **change)
        player.probe.report(status)
        text = f'{player.probe.report(status).message} {player.probe.values(status)}'
        if player.probe.torques:
            return f'{len(player.probe.torques)} torques published'
        return '' if expected in text else f'status {status}: {text}'
    return Fault(name, play, parameters)


def answered(name: str, expected: str, **change) -> Fault:
    """Return unusual messages on which the torque must follow the poses."""
    def play(player: Player) -> str:
        # After a jump between two parts of the motion the torque lags the pose.
        player.jump(5000.0)
        player.move(60, **change)
        player.finish_fits()
        end = time.monotonic() + 20.0
        while player.error() > 1.0 and time.monotonic() < end:
            # On a busy machine messages are still in transit.
            player.probe.spin(0.05)
        if (error := player.error()) > 1.0:
            return f'error of {error:.1f} N·m'
        text = ' '.join(status.message for status in player.probe.status.values())
        text += str(player.probe.values('input'))
        return '' if expected in text else f'{expected} is not reported: {text}'
    return Fault(name, play, {})


def floating(seed: int) -> Fault:
    """Return an arm that floats on the published torque and is guided by hand."""
    def play(player: Player) -> str:
        player.carry(Payload(2.0))
        player.jump(3000.0 + 77.0 * seed)
        before = player.model_in_use()
        player.move(5)
        player.probe.call('payload_changed')
        for _ in range(3):
            player.guide(10.0)
            player.finish_fits()
        after = player.model_in_use()
        text = player.probe.report('learning').message
        if after != before:
            return f'model accepted: {after}'
        return '' if 'published' in text else f'status learning: {text}'
    return Fault(f'guided by hand on the published torque, seed {seed}', play, {})


def all_faults(seeds: int) -> list[Fault]:
    """Return all faults of the campaign."""
    return [
        *(broken(kind, n, seed) for kind in KINDS for n in LENGTHS for seed in range(seeds)),
        *(real(seed, is_off_axis) for seed in range(10) for is_off_axis in (False, True)),
        *(real(seed, True, intermittent_brake) for seed in range(4)),
        *(unannounced(mass) for mass in (0.5, 1.0, 2.0)), contacts_only(10.0),
        *(floating(seed) for seed in range(3)),
        *(pause(seconds, action) for seconds in (0.15, 0.3, 1.0, 3.0)
          for action in ('hold', 'fade')),
        silent('angles in degrees', 'position_absurd', 'input', {}, scale=180.0 / np.pi),
        silent('no clock', 'use_sim_time', 'clock', {'use_sim_time': True}),
        silent('no torque limits', 'max_torque', 'feed-forward',
               {'max_torque': '[]', 'robot_description': 'off'}),
        answered('all joints one revolution further', '', offset=2.0 * np.pi),
        answered('all joints one revolution back', '', offset=-2.0 * np.pi),
        answered('stamps become 0', 'no_stamp', stamp=0.0),
        answered('velocity 0 while the arm moves', 'velocity_wrong', velocity=0.0),
    ]
