"""
Gravity after a payload change, on descriptions of real robots.

Run from the root of the repository:

    python -m bench.real_robots.payloads results/ --seeds 400-401 --jobs 2

A model is fitted to the two training runs of a case (`cases`, without hidden effects; two of three
have LuGre friction). Then a body of 2 to 20 % of the mass of the moving links, with its centre up
to 10 cm from the last joint, is attached, and the arm moves within the same box of poses. The
model is updated with the first 12 s and with 40 s of that motion, without and with the
description of the arm. The error is that of the gravity torque over the trained box: rms of the
worst joint, in percent of the arm's largest gravity torque. The error of the model without an
update shows the size of the change.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
import json
from multiprocessing import get_context
import os
from pathlib import Path
import sys
import tempfile
from zlib import crc32

from bench.real_robots.arms import arm_of, SOURCES, urdf, with_other_masses
from bench.real_robots.cases import (
    box_of, drawn_friction, motion_in, recorded, Run, scales, sites_in)
from bench.real_robots.run import arm_names, seeds
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, gravity_torque, Payload, with_payload
import numpy as np

SECONDS = (12.0, 40.0)
_POSES = 500
# Mass of the body as a share of that of the moving links; distance of its centre in m.
_MASS, _DISTANCE = (0.02, 0.2), 0.1


def main() -> int:
    """Print the error of every arm before and after updates."""
    parser = argparse.ArgumentParser(description='Gravity after a payload change.')
    parser.add_argument('folder', help='folder of results')
    parser.add_argument('--seeds', type=seeds, default=[400], help='e.g. 400 or 300-304')
    parser.add_argument('--arms', type=arm_names, default=','.join(SOURCES))
    parser.add_argument('--jobs', type=int, default=1, help='processes (default: %(default)s)')
    args = parser.parse_args()
    folder = Path(args.folder)
    folder.mkdir(parents=True, exist_ok=True)
    tasks = [(arm, seed) for seed in args.seeds for arm in args.arms]
    columns = ['not updated %', *(f'{seconds:g} s %' for seconds in SECONDS)]
    print('| arm.seed | kg | ' + ' | '.join([*columns, *(f'described {c}' for c in columns)])
          + ' |\n' + '|---' * (2 + 2 * len(columns)) + '|')
    results = {}
    with get_context('fork').Pool(args.jobs) as pool:
        for (arm, seed), (mass, errors) in zip(tasks, pool.imap(_errors, tasks)):
            results[f'{arm}.{seed}'] = errors
            print(f'| {arm}.{seed} | {mass:.2f} | '
                  + ' | '.join(f'{x:.3f}' for x in errors) + ' |', flush=True)
    (folder / 'payloads.json').write_text(json.dumps(results, indent=1))
    table = np.array(list(results.values()))
    for word, row in (('median', np.median(table, axis=0)), ('worst', table.max(axis=0))):
        print(f'| {word} | | ' + ' | '.join(f'{x:.3f}' for x in row) + ' |')
    return 0


@dataclass(frozen=True, eq=False)
class Case:
    """
    Two runs of an arm, one with a payload, and poses (K, N) in rad of the trained box.

    `truth` (K, N) is the gravity torque with the payload, `largest` that of the arm, N·m.
    """

    arm: Arm
    train: tuple[Run, ...]
    loaded: Run
    payload: Payload
    poses: FloatArray
    truth: FloatArray
    largest: float

    @staticmethod
    def drawn(name: str, seed: int) -> Case:
        """Return the case of an arm and a seed."""
        arm = arm_of(urdf(name))
        rng = np.random.default_rng([seed, crc32(name.encode()), 2])
        scale, largest = scales(arm)
        noise = rng.uniform(0.001, 0.002, arm.n_joints) * scale
        low, high = box_of(arm, rng)
        friction = drawn_friction(sites_in(arm, scale, low, high), rng)
        moving = sum(body.mass for body in arm.model.inertias[1:])
        direction = rng.standard_normal(3)
        payload = Payload(float(np.exp(rng.uniform(*np.log(_MASS))) * moving), tuple(
            rng.uniform(0.0, _DISTANCE) * direction / np.linalg.norm(direction)))
        held = with_payload(arm, payload)
        runs = [recorded(each, motion_in(arm, low, high, rng), friction, noise, rng)
                for each in (arm, arm, held)]
        q = np.concatenate([run.q for run in runs[:2]])
        poses = rng.uniform(q.min(axis=0), q.max(axis=0), (_POSES, arm.n_joints))
        return Case(arm, tuple(runs[:2]), runs[2], payload, poses, gravity_torque(held, poses),
                    largest)

    def recording(self, runs: Sequence[Run], seconds: float = np.inf) -> gc.Recording:
        """Return the first part of runs as a recording."""
        parts = [run.t < run.t[0] + seconds for run in runs]
        q, tau, t, qd = ([getattr(run, key)[part] for run, part in zip(runs, parts)]
                         for key in ('q', 'tau', 't', 'qd'))
        return gc.Recording.from_arrays(q, tau, t, qd=qd, names=self.arm.joints)

    def error(self, model: gc.Model) -> float:
        """Return the error of a model in percent of the largest torque, rms of the worst joint."""
        error = model.predict(self.poses)[:, [
            model.joints.index(name) for name in self.arm.joints]] - self.truth
        return 100.0 * float(np.sqrt((error ** 2).mean(axis=0)).max() / self.largest)


def _errors(task: tuple[str, int]) -> tuple[float, list[float]]:
    """Return the mass in kg and the errors of a case, in the order of the table."""
    name, seed = task
    case, errors = Case.drawn(name, seed), []
    train = case.recording(case.train)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.urdf'
        path.write_text(with_other_masses(urdf(name), seed), encoding='utf-8')
        for axes in (None, path):
            model = gc.fit(train, urdf=axes)
            errors.append(case.error(model))
            errors += [case.error(gc.update(model, case.recording([case.loaded], seconds),
                                            urdf=axes)) for seconds in SECONDS]
    return case.payload.mass, errors


if __name__ == '__main__':
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    sys.exit(main())
