"""
Time and memory for an hour of joint states at 1 kHz, compared with decoding by rosbags.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.scale.bags [--minutes 60] [-o bench/scale/results.json]

Writes an MCAP of seven joints (zstd, 0.7 GB for an hour; a minute or two) into a temporary folder,
or uses that of --bag. rosbags and our reader alternate in reading one minute of the same
recording. Rates are per second of processor time, which stays comparable on a busy machine;
reading uses one core.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.joint_state_cdr import LayoutDecoder
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.recordings.storage import open_storage
import numpy as np
from rosbags.highlevel import AnyReader

TOPIC = '/joint_states'


def record(path: Path, minutes: float) -> None:
    """Write slow sines of seven joints, with gravity-like torques and noise."""
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


def decode(path: Path) -> int:
    with open_storage(path) as storage:
        decoder = LayoutDecoder()
        return sum(len(block.which) for batch in storage.batches(TOPIC)
                   for block in decoder.decode(batch))


def by_rosbags(path: Path) -> int:
    count = 0
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            count += bool(len(message.effort))
    return count


def rate(call, path: Path) -> float:
    """Return messages a second of processor time."""
    started = time.process_time()
    return call(path) / (time.process_time() - started)


def timed(*call: str | Path) -> dict[str, float]:
    """Run a verb of `gravity_comp` as a user does; return its time and peak memory."""
    started = time.perf_counter()
    process = subprocess.Popen([sys.executable, '-m', 'gravity_comp_ros.cli', *map(str, call)],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise RuntimeError(f'{call[0]} failed')
    return {'seconds': time.perf_counter() - started, 'megabytes': used.ru_maxrss / 1e3,
            'processor_seconds': used.ru_utime + used.ru_stime}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--minutes', type=float, default=60.0)
    parser.add_argument('--bag', type=Path, default=None)
    parser.add_argument('-o', '--output', type=Path,
                        default=Path(__file__).with_name('results.json'))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bag, minute = args.bag or Path(folder) / 'hour.mcap', Path(folder) / 'minute.mcap'
        if args.bag is None:
            record(bag, args.minutes)
        record(minute, 1.0)
        results = {'info': timed('info', bag),
                   'fit': timed('fit', bag, '-o', Path(folder) / 'model.json')}
        rates = [(rate(by_rosbags, minute), rate(decode, minute)) for _ in range(5)]
        theirs, ours = np.median(rates, axis=0)
        results['minute'] = {'rosbags_per_s': theirs, 'decode_per_s': ours,
                             'ratio': float(np.median([b / a for a, b in rates]))}
        started = time.process_time()
        whole = read_bag(bag)
        seconds = time.process_time() - started
        results['read'] = {'messages': whole.report.n_messages, 'seconds': seconds,
                           'per_s': whole.report.n_messages / seconds,
                           'decode_per_s': rate(decode, bag),
                           'kept': len(whole.samples)}
    args.output.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
