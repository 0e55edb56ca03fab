"""
Errors of `fit` and `update` for an arm in MuJoCo that a controller moves slowly.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.closed_loop.open_loop [--seeds 10] [--build six seven]

75 s without a load, then 15 s or 75 s with 2 kg, at 100 Hz, through the gate of `fit` and
`update`. Each joint has damping and 1 N·m of Coulomb friction. An error is the RMS error of
gravity of the worst joint at 1000 poses within the range of the motion. With `--mount` the arm is
on a wall (90 degrees) or a ceiling (180) and its URDF is upright.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path
import tempfile
import time

from bench.closed_loop.arm import BUILDS, Controller, Load, MujocoArm, SlowPath, STEP, urdf
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import JointSamples
import numpy as np

LOAD = Load(2.0)
RATE = 100.0
POSES = 1000


def record(arm: MujocoArm, path: SlowPath, start: float, duration: float) -> JointSamples:
    """Return the measurements of an arm that follows a path from time `start`."""
    control = Controller(len(arm.joints))
    arm.place(path.at(start)[0])
    every, rows = round(1.0 / (RATE * STEP)), []
    # One second at rest for the controller to converge.
    for k in range(-1000, round(duration / STEP)):
        t = start + max(k, 0) * STEP
        q, qd = path.at(t)
        tau = control.torque(arm, q, qd if k >= 0 else 0.0 * qd)
        if k >= 0 and k % every == 0:
            rows.append((t, *arm.measured(tau)))
        arm.step(tau)
    t, q, qd, tau = (np.array(part) for part in zip(*rows))
    return JointSamples.single_run(arm.joints, t, q, qd, tau)


def box_poses(samples: JointSamples) -> np.ndarray:
    """Return random poses within the range of samples."""
    return np.random.default_rng(5).uniform(samples.q.min(axis=0), samples.q.max(axis=0),
                                            (POSES, samples.n_joints))


def error(model, arm: MujocoArm, q: np.ndarray) -> float:
    """Return the RMS error of gravity of the worst joint in N·m at poses q."""
    return float(np.sqrt(((model.predict(q) - arm.gravity(q)) ** 2).mean(axis=0)).max())


def measure(build: str, seed: int, description: Path | None, mount: float) -> dict[str, float]:
    """Return the errors of one arm and one path."""
    bare = MujocoArm(build, None, seed, mount)
    loaded = MujocoArm(build, LOAD, seed + 100, mount)
    path = SlowPath.random(len(bare.joints), seed)
    first = gc.Recording(record(bare, path, 0.0, 75.0))
    begun = time.process_time()
    model = gc.fit(first, urdf=description)
    result = {'fit s': time.process_time() - begun}
    poses = box_poses(first.samples)
    result['no load'] = error(model, bare, poses)
    second = record(loaded, path, 75.0, 75.0)
    for seconds in (15.0, 75.0):
        part = gc.Recording(second.select(second.t < 75.0 + seconds))
        begun = time.process_time()
        updated = gc.update(model, part)
        result[f'update {seconds:.0f} s'] = error(updated, loaded, poses)
        result['update s'] = time.process_time() - begun
    return result


def main() -> None:
    """Measure, and print a line per case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--seeds', type=int, default=10, help='first seed not used')
    parser.add_argument('--build', nargs='+', default=list(BUILDS))
    parser.add_argument('--mount', type=float, default=0.0, help='degrees')
    args = parser.parse_args()
    for described, build in itertools.product((False, True), args.build):
        with tempfile.NamedTemporaryFile('w', suffix='.urdf') as file:
            file.write(urdf(BUILDS[build]))
            file.flush()
            rows = [measure(build, seed, Path(file.name) if described else None, args.mount)
                    for seed in range(args.first, args.seeds)]
            print(f'{build:6s} {"with" if described else "without"} description: ' + ', '.join(
                f'{key} worst {max(row[key] for row in rows):.3f} median '
                f'{np.median([row[key] for row in rows]):.3f}' for key in rows[0]), flush=True)
            print('       ', [[round(value, 3) for value in row.values()] for row in rows],
                  flush=True)


if __name__ == '__main__':
    main()
