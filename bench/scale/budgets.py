"""
Processor time and memory of each step of the loop, on recordings of several sizes.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.scale.budgets [--folder DIR] [CASE ...]
    OPENBLAS_NUM_THREADS=1 python3 -m bench.scale.budgets --decoding

Recordings are simulated first and written into a temporary folder, or into --folder, which is
kept. Each case then runs a command of the package. The table has the processor seconds of its
process and children without those of its imports, and its peak memory. Reading the recording is
part of the command. Without case names all cases run (a few minutes).

With --decoding our reader and rosbags alternate in decoding a minute of seven joints at 1 kHz
(MCAP, zstd); rates are per second of processor time, which stays comparable on a busy machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile
import time

from gravity_comp_ros.recordings.joint_state_cdr import decode
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.recordings.storage import open_storage
import numpy as np
from rosbags.highlevel import AnyReader

TOPIC = '/joint_states'
CLI = ('-m', 'gravity_comp_ros.cli')
# Modules that the commands import when they run.
IMPORTS = ('-c', 'import gravity_comp_ros.api.loop, gravity_comp_ros.cli, scipy.special, '
           + ', '.join(f'gravity_comp_ros.commands.{verb}' for verb in ('diagnose', 'fit')))


def multisine(speed: float, rate: float, seconds: float, seed: int,
              friction: tuple[str, ...]) -> tuple[str, ...]:
    """Return the options of `synth` for an iiwa with friction on some joints."""
    hidden = [word for joint in friction
              for word in ('--hidden', f'coulomb_friction:iiwa_joint_{joint}')]
    return ('--motion', 'multisine', '--max-speed', str(speed), '--rate', str(rate), '--duration',
            str(seconds), '--noise', '0.1', '--seed', str(seed), *hidden)


EVERY = tuple('1234567')
# Options of `synth` for each recording.
RECORDINGS = {
    'eq17.mcap': ('--motion', 'eq17', '--noise', '0.1'),
    'long.mcap': multisine(0.3, 50.0, 600.0, 3, EVERY),
    'slow.mcap': multisine(0.02, 50.0, 600.0, 4, EVERY),
    'loaded.mcap': ('--motion', 'eq17', '--noise', '0.1', '--payload', '2', '--duration', '15',
                    '--seed', '2'),
    'hour.mcap': multisine(0.12, 100.0, 3600.0, 1, ('4=0.8',)),
    **{f'run{k}.mcap': multisine(0.3, 50.0, 150.0, k, EVERY) for k in range(1, 6)},
}
# Verb and arguments of each case.
CASES: dict[str, tuple[str, ...]] = {
    'fit of 500 samples': ('fit', 'eq17.mcap', '-o', 'made.json'),
    'fit of 30 000 samples, fast': ('fit', 'long.mcap', '--all-samples', '-o', 'made.json'),
    'fit of 30 000 samples, slow': ('fit', 'slow.mcap', '--all-samples', '-o', 'made.json'),
    'fit of an hour at 100 Hz': ('fit', 'hour.mcap', '-o', 'made.json'),
    'info of an hour at 1 kHz': ('info', 'kilohertz.mcap'),
    'update': ('update', 'loaded.mcap', '--model', 'eq17.json', '-o', 'made.json'),
    'diagnose five runs': ('diagnose', *(f'run{k}.mcap' for k in range(1, 6))),
    'plan': ('plan', 'eq17.mcap', '--model', 'eq17.json', '--settle', 'coulomb_friction,gravity',
             '-o', 'made.yaml'),
}


def kilohertz(path: Path, minutes: float) -> None:
    """Write seven joints at 1 kHz: slow sines, gravity-like torques."""
    t = np.arange(int(60000 * minutes)) / 1000
    w = 2 * np.array([0.011, 0.017, 0.023, 0.029, 0.031, 0.037, 0.041])
    q, qd = np.sin(t[:, None] * w + np.arange(7)), np.cos(t[:, None] * w + np.arange(7)) * w
    tau = np.column_stack([
        0 * t, 40 * np.sin(q[:, 1]), 10 * np.sin(q[:, 1]) * np.sin(q[:, 2]),
        20 * np.sin(q[:, 1] - q[:, 3]), np.sin(q[:, 4]) * np.sin(q[:, 1]),
        np.sin(q[:, 5]) * np.cos(q[:, 1]), 0 * t])
    tau += 0.1 * np.random.default_rng(0).normal(size=q.shape)
    names = tuple(f'iiwa_joint_{k}' for k in range(1, 8))
    write_bag(path, [JointTopic(TOPIC, names, t, q, qd, tau)])


def run(folder: Path, *arguments: str) -> tuple[float, float]:
    """Run Python in a folder; return processor seconds and peak memory in MB of the process."""
    child = subprocess.Popen([sys.executable, *arguments], cwd=folder, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f'{" ".join(arguments)} failed')
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def prepare(folder: Path, name: str) -> None:
    """Simulate a recording, or fit a model to the recording of its name."""
    if (folder / name).exists():
        return
    if name in RECORDINGS:
        run(folder, *CLI, 'synth', '-o', name, *RECORDINGS[name])
    elif name == 'kilohertz.mcap':
        kilohertz(folder / name, 60.0)
    elif name == 'eq17.json':
        prepare(folder, 'eq17.mcap')
        run(folder, *CLI, 'fit', 'eq17.mcap', '-o', name)


def decoding(folder: Path) -> None:
    """Print how many messages of a minute at 1 kHz are decoded in a second of processor time."""
    path = folder / 'minute.mcap'
    kilohertz(path, 1.0)

    def ours() -> int:
        with open_storage(path) as storage:
            return sum(len(block.which) for batch in storage.batches(TOPIC)
                       for block in decode(batch))

    def theirs() -> int:
        with AnyReader([path]) as reader:
            return sum(bool(len(reader.deserialize(raw, connection.msgtype).effort))
                       for connection, _, raw in reader.messages())

    rates: dict[Callable[[], int], list[float]] = {theirs: [], ours: []}
    for _ in range(5):
        for read, measured in rates.items():
            started = time.process_time()
            measured.append(read() / (time.process_time() - started))
    rosbags, decoded = map(median, rates.values())
    print(f'messages decoded a second: rosbags {rosbags:.0f}, ours {decoded:.0f}, '
          f'{decoded / rosbags:.1f} times as many')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('cases', nargs='*', metavar='CASE', help='; '.join(CASES))
    parser.add_argument('--folder', type=Path, default=None)
    parser.add_argument('--decoding', action='store_true', help='rate of decoding alone')
    args = parser.parse_args()
    if unknown := set(args.cases) - set(CASES):
        parser.error(f'no case {", ".join(unknown)}')
    with tempfile.TemporaryDirectory() as name:
        folder = (args.folder or Path(name)).resolve()
        folder.mkdir(exist_ok=True)
        if args.decoding:
            decoding(folder)
            return
        imports = run(folder, *IMPORTS)[0]
        print('| | processor time without imports | memory |\n|---|---|---|')
        for case in args.cases or CASES:
            for word in CASES[case]:
                prepare(folder, word)
            seconds, memory = run(folder, *CLI, *CASES[case])
            print(f'| {case} | {seconds - imports:.2f} s | {memory:.0f} MB |', flush=True)


if __name__ == '__main__':
    main()
