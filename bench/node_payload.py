#!/usr/bin/env python3
"""
Time from payload_changed to a better model, in the running node, on Eq. (17) of Yu 2022.

    python3 -m bench.node_payload [--rate 100] [--payloads 2 0.5] [--starts 200 240 280] [--json F]

The node has a model of the bare arm (100 s of the same motion). Then the arm carries a payload,
`~/payload_changed` is called, and joint states with 0.1 N·m of noise are sent in real time. Prints
the seconds of motion until the first better model, its computing time, and the error of both
models on the next ten seconds of motion.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
import re
import subprocess
import sys
import tempfile
import time

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
# Maximum time until a better model, and time of the evaluation after it, s.
MAX_DURATION = 40.0
EVALUATION = 10.0


def synth(folder: Path, start: float, payload: float, rate: float) -> JointSamples:
    """Return the motion of an arm that carries a payload."""
    out = folder / f'{start:g}_{payload:g}.mcap'
    subprocess.run(
        [sys.executable, '-m', 'gravity_comp_ros.cli', 'synth', '--motion', 'eq17', '--start',
         str(start), '--duration', str(MAX_DURATION + EVALUATION), '--rate', str(rate),
         '--payload', str(payload), '--noise', '0.1', '--seed', str(int(start)), '-o', str(out)],
        check=True, capture_output=True, cwd=ROOT)
    return read_bag(out).samples


class Run:
    """Sends samples in real time."""

    def __init__(self, probe, samples: JointSamples) -> None:
        self.probe, self.samples, self.k = probe, samples, 0
        self.began = time.monotonic()

    def send(self, seconds: float, until=lambda: False) -> None:
        """Send the samples that are due, for some seconds or until a condition is true."""
        end = time.monotonic() + seconds
        t = self.samples.t
        while time.monotonic() < end and not until():
            due = time.monotonic() - self.began + t[0]
            while self.k < len(t) and t[self.k] <= due:
                k = self.k
                self.probe.send(self.samples.names, t[k], self.samples.q[k],
                                self.samples.qd[k], self.samples.tau[k])
                self.k += 1
            self.probe.loop.spin_once(timeout_sec=0.002)


def measure(samples: JointSamples, model: Path) -> dict:
    """Return the figures of one payload change."""
    from bench.shared.ros_harness import running
    with running({'model_file': model, 'max_torque': '[200.0]', 'diagnostics_rate': 20.0,
                  'stale_after': 5.0}) as (_, probe):
        probe.until(lambda: 'learning' in probe.status or 'model' in probe.status)
        run = Run(probe, samples)
        run.send(1.0)
        answer = probe.call('payload_changed')
        assert answer.success, answer.message
        called = time.monotonic()
        before = probe.status['model'].message
        run.send(MAX_DURATION - 1.0, lambda: probe.status['model'].message != before)
        seconds = time.monotonic() - called
        if probe.status['model'].message == before:
            raise SystemExit(f'no better model: {probe.status["learning"].message}')
        last_fit = probe.values('learning')['last fit']
        probe.residuals.clear()
        first = run.k
        run.send(EVALUATION)
        old = old_model_error(samples, first, run.k, model)
        new = np.sqrt(np.mean([np.square(m.effort) for m in probe.residuals], axis=0))
    computing = float(re.search(r'samples, ([\d.]+) s', last_fit).group(1))
    return {'seconds': seconds, 'computing': computing, 'fit': last_fit,
            'rmse_before': old, 'rmse_after': float(new.max())}


def old_model_error(samples: JointSamples, first: int, last: int, model: Path) -> float:
    """Return the RMS error of the old model on the same samples, worst joint, N·m."""
    from gravity_comp_ros.models.model_file import load_model
    part = samples.select(np.arange(first, last))
    error = part.tau - load_model(model).predict(part.q)
    return float(np.sqrt(np.mean(error ** 2, axis=0)).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--rate', type=float, default=100.0)
    parser.add_argument('--payloads', type=float, nargs='+', default=[2.0, 0.5])
    parser.add_argument('--starts', type=float, nargs='+', default=[200.0, 240.0, 280.0])
    parser.add_argument('--formulations', nargs='+', default=['potential', 'chain'])
    parser.add_argument('--json', type=Path)
    args = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bare = read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples
        for formulation in args.formulations:
            model = folder / f'{formulation}.json'
            save_model(model, fit(bare, FitOptions(formulation=formulation)).model)
            for payload in args.payloads:
                for start in args.starts:
                    one = measure(synth(folder, start, payload, args.rate), model)
                    results.append({'formulation': formulation, 'payload': payload,
                                    'start': start, **one})
                    print(f'{formulation}, {payload:g} kg at {start:g} s: '
                          f'{one["seconds"]:.1f} s of motion, {one["computing"]:.2f} s of '
                          f'computing; error of the worst joint {one["rmse_before"]:.2f} '
                          f'-> {one["rmse_after"]:.2f} N·m', flush=True)
    worst = max(results, key=lambda one: one['seconds'])
    print(f'slowest: {worst["seconds"]:.1f} s of motion; longest computing time: '
          f'{max(one["computing"] for one in results):.2f} s')
    if args.json:
        args.json.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
