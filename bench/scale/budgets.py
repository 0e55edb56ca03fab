"""
Processor time and memory of each step of the loop, on recordings of several sizes.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.scale.budgets [--folder DIR] [CASE ...]
    OPENBLAS_NUM_THREADS=1 python3 -m bench.scale.budgets --decoding

Recordings are simulated first and written into a temporary folder, or into --folder, which is
kept. Each case then runs a command of the package in its own process. The table has the processor
seconds of that process and its children, with imports separate, and its peak memory. Reading the
recording is part of the command. Without case names all cases run (a few minutes).

With --decoding our reader and rosbags alternate in decoding a minute of seven joints at 1 kHz
(MCAP, zstd); rates are per second of processor time, which stays comparable on a busy machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
import json
from multiprocessing import Process
import os
from pathlib import Path
import resource
from statistics import median
import subprocess
import sys
import tempfile
import time

# Modules that commands import when they run. They are imported before, to exclude their time.
_IMPORTS = ('gravity_comp_ros.cli', 'gravity_comp_ros.commands.add',
            'gravity_comp_ros.commands.diagnose', 'gravity_comp_ros.commands.fit',
            'gravity_comp_ros.commands.update',
            'gravity_comp_ros.recordings.bag', 'gravity_comp_ros.api.loop', 'scipy.linalg',
            'scipy.special')
TOPIC = '/joint_states'
HOUR = ('--motion', 'multisine', '--max-speed', '0.12', '--rate', '100', '--duration', '3600',
        '--noise', '0.1', '--hidden', 'coulomb_friction:iiwa_joint_4=0.8', '--seed', '1')


def _synth(*arguments: str) -> Callable[[Path], None]:
    """Return a function that simulates a recording with `synth`."""
    def make(path: Path) -> None:
        _command('synth', '-o', str(path), *arguments)
    return make


def _friction(seconds: float, rate: float, seed: int, max_speed: float) -> Callable[[Path], None]:
    """Return a function that simulates an iiwa with friction on every joint."""
    hidden = [word for k in range(1, 8)
              for word in ('--hidden', f'coulomb_friction:iiwa_joint_{k}')]
    return _synth('--motion', 'multisine', '--max-speed', str(max_speed), '--rate', str(rate),
                  '--duration', str(seconds), '--noise', '0.1', '--seed', str(seed), *hidden)


def _kilohertz(minutes: float) -> Callable[[Path], None]:
    """Return a function that writes seven joints at 1 kHz: slow sines, gravity-like torques."""
    def make(path: Path) -> None:
        from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
        import numpy as np
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
    return make


def _twelve(seed: int, seconds: float = 100.0, rate: float = 20.0) -> Callable[[Path], None]:
    """Return a function that simulates an arm of twelve joints with friction on one of them."""
    def make(path: Path) -> None:
        from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
        from gravity_comp_ros.simulation.disturbances.friction import Friction
        from gravity_comp_ros.simulation.disturbances.friction import LuGre
        from bench.cases.arms import generated_arm
        from gravity_comp_ros.simulation.motions import multisine
        from gravity_comp_ros.simulation.synthesise import NoiseOptions
        from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
        import numpy as np
        arm = generated_arm(4, 12, right_angles=True)
        motion = multisine(arm.lower, arm.upper, np.full(12, 1.5), seed, duration=seconds,
                           rate=rate)
        options = SynthesisOptions(NoiseOptions(absolute=0.1), seed,
                                   disturbances=(Friction(3, LuGre(2.0)),))
        write_bag(path, [joint_states(synthesise(arm, motion, options), '/joint_states')])
    return make


RECORDINGS: dict[str, Callable[[Path], None]] = {
    'eq17.mcap': _synth('--motion', 'eq17', '--noise', '0.1'),
    'long.mcap': _friction(600.0, 50.0, 3, 0.3),
    'slow.mcap': _friction(600.0, 50.0, 4, 0.02),
    'loaded.mcap': _synth('--motion', 'eq17', '--noise', '0.1', '--payload', '2', '--duration',
                          '15', '--seed', '2'),
    'hour.mcap': _synth(*HOUR),
    'kilohertz.mcap': _kilohertz(60.0),
    **{f'run{k}.mcap': _friction(150.0, 50.0, k, 0.3) for k in range(1, 6)},
    **{f'twelve{k}.mcap': _twelve(k) for k in range(1, 4)},
}
# Initial models of cases, and the recordings that they are fitted to.
MODELS = {'eq17.json': ('eq17.mcap',), 'hour.json': ('hour.mcap',)}
# Verb and arguments of each case.
CASES: dict[str, tuple[str, ...]] = {
    'fit of 500 samples': ('fit', 'eq17.mcap', '-o', 'made.json'),
    'fit of 30 000 samples, fast': ('fit', 'long.mcap', '--all-samples', '-o', 'made.json'),
    'fit of 30 000 samples, slow': ('fit', 'slow.mcap', '--all-samples', '-o', 'made.json'),
    'fit of twelve joints': ('fit', 'twelve1.mcap', '-o', 'made.json'),
    'fit of an hour at 100 Hz': ('fit', 'hour.mcap', '-o', 'made.json'),
    'fit of an hour at 1 kHz': ('fit', 'kilohertz.mcap', '-o', 'made.json'),
    'info of an hour at 1 kHz': ('info', 'kilohertz.mcap'),
    'update': ('update', 'loaded.mcap', '--model', 'eq17.json', '-o', 'made.json'),
    'diagnose five runs': ('diagnose', *(f'run{k}.mcap' for k in range(1, 6))),
    'diagnose an hour at 1 kHz': ('diagnose', 'kilohertz.mcap'),
    'diagnose twelve joints': ('diagnose', *(f'twelve{k}.mcap' for k in range(1, 4))),
    'add to an hour at 100 Hz': (
        'add', 'coulomb_friction:iiwa_joint_4', 'hour.mcap', '--model', 'hour.json', '--dry-run'),
    'plan': ('plan', 'eq17.mcap', '--model', 'eq17.json', '--settle', 'coulomb_friction,gravity',
             '-o', 'made.yaml'),
}


def _command(*arguments: str) -> None:
    subprocess.run([sys.executable, '-m', 'gravity_comp_ros.cli', *arguments], check=True,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _used() -> float:
    """Return the processor time of this process and its children in s."""
    return sum(used.ru_utime + used.ru_stime for used in map(
        resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))


def _peak() -> float:
    """Return the peak memory of this process or of a child in MB."""
    return max(resource.getrusage(who).ru_maxrss for who in (
        resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1e3


def measure(arguments: Sequence[str]) -> dict[str, float]:
    """Run a command in this process; return its processor seconds and peak memory."""
    from importlib import import_module
    for name in _IMPORTS:
        import_module(name)
    from gravity_comp_ros.cli import main as run
    imports = _used()
    with (Path(os.devnull).open('w') as devnull, redirect_stdout(devnull),
          redirect_stderr(devnull)):
        status = run(list(arguments))
    return {'status': status or 0, 'imports': imports, 'seconds': _used() - imports,
            'megabytes': _peak()}


def _measured(folder: Path, arguments: Sequence[str]) -> dict[str, float]:
    """Run a command in a new process; return the result of `measure`."""
    program = [sys.executable, str(Path(__file__).resolve())]
    child = subprocess.run([*program, '--measure', *arguments],
                           cwd=folder, stdout=subprocess.PIPE, check=True)
    return json.loads(child.stdout)


def decoding(folder: Path) -> None:
    """Print how many messages of a minute at 1 kHz are decoded in a second of processor time."""
    from gravity_comp_ros.recordings.joint_state_cdr import LayoutDecoder
    from gravity_comp_ros.recordings.storage import open_storage
    from rosbags.highlevel import AnyReader
    path = folder / 'minute.mcap'
    _kilohertz(1.0)(path)

    def ours() -> int:
        with open_storage(path) as storage:
            decoder = LayoutDecoder()
            return sum(len(block.which) for batch in storage.batches(TOPIC)
                       for block in decoder.decode(batch))

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


def _prepare(folder: Path, needed: set[str]) -> None:
    for name, bags in MODELS.items():
        if name in needed:
            needed |= set(bags)
    for name, make in RECORDINGS.items():
        if name in needed and not (folder / name).exists():
            # In a separate process, because a child inherits its parent's peak memory.
            maker = Process(target=make, args=(folder / name,))
            maker.start()
            maker.join()
    for name, bags in MODELS.items():
        if name in needed and not (folder / name).exists():
            _command('fit', *(str(folder / bag) for bag in bags), '-o', str(folder / name))


def main() -> int:
    if sys.argv[1:2] == ['--measure']:
        print(json.dumps(measure(sys.argv[2:])))
        return 0
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
            return 0
        print('| | processor time | imports | memory |\n|---|---|---|---|')
        for case in args.cases or CASES:
            _prepare(folder, set(CASES[case]))
            used = _measured(folder, CASES[case])
            failed = f' (exit {used["status"]})' if used['status'] else ''
            print(f'| {case}{failed} | {used["seconds"]:.2f} s | {used["imports"]:.1f} s | '
                  f'{used["megabytes"]:.0f} MB |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
