"""Errors of gravity in percent over arms and seeds: command line, processes and table."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import json
from multiprocessing import get_context
import os
from pathlib import Path

from bench.real_robots.arms import SOURCES
from bench.real_robots.run import arm_names, seeds
from bench.shared.stored import row_of
from gravity_comp_ros.data.samples import FloatArray
import numpy as np


def judged(description: str, columns: Sequence[str],
           errors: Callable[[str, int], Sequence[float]]) -> int:
    """
    Print the figures of every requested arm and seed, with least, median and worst of each.

    They are also written to `errors.json` of the folder of the command line.

    :param errors: returns the figures of an arm and a seed, in the order of the columns.
    """
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('folder', type=Path, help='folder of results')
    parser.add_argument('--seeds', type=seeds, default=[400], help='e.g. 400 or 300-304')
    parser.add_argument('--arms', type=arm_names, default=','.join(SOURCES))
    parser.add_argument('--jobs', type=int, default=1, help='processes (default: %(default)s)')
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    tasks = [(arm, seed) for seed in args.seeds for arm in args.arms]
    print(row_of(('arm.seed', *columns)), '|' + '---|' * (1 + len(columns)), sep='\n')
    results: dict[str, list[float]] = {}
    with get_context('fork').Pool(args.jobs) as pool:
        pending = [(f'{arm}.{seed}', pool.apply_async(errors, (arm, seed))) for arm, seed in tasks]
        for name, result in pending:
            results[name] = list(result.get())
            print(row_of((name, *map(_figure, results[name]))), flush=True)
    (args.folder / 'errors.json').write_text(json.dumps(results, indent=1))
    table = np.array(list(results.values()))
    for word, row in (('least', table.min(axis=0)), ('median', np.median(table, axis=0)),
                      ('worst', table.max(axis=0))):
        print(row_of((word, *map(_figure, row))))
    return 0


def rms(torque: FloatArray, truth: FloatArray, largest: float) -> float:
    """Return the rms error of torques (K, N), worst joint, in percent of the largest torque."""
    error = torque - truth
    return 100.0 * float(np.sqrt((error ** 2).mean(axis=0)).max() / largest)


def _figure(value: float) -> str:
    return f'{value:.3g}'
