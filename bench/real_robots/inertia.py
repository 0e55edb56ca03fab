"""
Gravity learned from slow motion with inertia, on descriptions of real robots.

Run from the root of the repository:

    python -m bench.real_robots.inertia results/ --seeds 400

One run of 100 s at 5 Hz of every arm (500 samples, as in the training of Yu 2022), a multisine
anywhere within the joint limits at up to 0.2 rad/s, full rigid-body dynamics, noise as in
`cases`, no friction and no hidden effect. The gate of slow samples is wide enough for all of them,
as with `fit --max-speed 0.25`: at the default of 0.15 rad/s a quarter of the samples is not
fitted, and the fastest parts of the range are extrapolated. The error is that of the gravity
torque of `fit` over 1000 poses within the whole joint limits, which the motion covers in part: rms
of the worst joint, in percent of the arm's largest gravity torque. The floor is the error of least
squares on Pinocchio's regressor with the exact motion and the true noise.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
import sys
import tempfile
from zlib import crc32

from bench.real_robots.arms import arm_of, SOURCES, urdf, with_other_masses
from bench.real_robots.cases import recorded, regressor, scales
from bench.real_robots.run import arm_names, seeds
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
from gravity_comp_ros.simulation.motions import Motion, multisine, MultisineOptions
import numpy as np

_RUNS, _DURATION, _RATE, _SPEED, _POSES = 1, 100.0, 5.0, 0.2, 1000
_GATE = gc.GateOptions(max_speed=0.25)


def main() -> int:
    """Print the error of every arm, without and with description, and the floor."""
    parser = argparse.ArgumentParser(description='Gravity from slow motion with inertia.')
    parser.add_argument('folder', help='folder of results')
    parser.add_argument('--seeds', type=seeds, default=[400], help='e.g. 400 or 300-304')
    parser.add_argument('--arms', type=arm_names, default=','.join(SOURCES))
    args = parser.parse_args()
    folder = Path(args.folder)
    folder.mkdir(parents=True, exist_ok=True)
    print('| arm.seed | floor % | fit % | x floor | described % | x floor |\n' + '|---' * 6 + '|')
    results = {}
    for seed in args.seeds:
        for arm in args.arms:
            errors = results[f'{arm}.{seed}'] = errors_of(arm, seed)
            floor, plain, described = errors
            print(f'| {arm}.{seed} | {floor:.4f} | {plain:.4f} | {plain / floor:.1f} | '
                  f'{described:.4f} | {described / floor:.1f} |', flush=True)
    (folder / 'inertia.json').write_text(json.dumps(results, indent=1))
    plain_ratio, described_ratio = (np.array([(e[k] / e[0]) for e in results.values()])
                                    for k in (1, 2))
    names = list(results)
    print(f'without description {np.median(plain_ratio):.1f} x floor in the median, '
          f'{plain_ratio.max():.1f} at most ({names[int(plain_ratio.argmax())]}); with it '
          f'{np.median(described_ratio):.1f} and {described_ratio.max():.1f} '
          f'({names[int(described_ratio.argmax())]})')
    return 0


def errors_of(name: str, seed: int) -> tuple[float, float, float]:
    """Return the errors in percent of the floor, of `fit`, and of `fit` with the description."""
    arm = arm_of(urdf(name))
    rng = np.random.default_rng([seed, crc32(name.encode()), 1])
    scale, largest = scales(arm)
    noise = rng.uniform(0.001, 0.002, arm.n_joints) * scale
    options = MultisineOptions(_SPEED, _DURATION)
    motions = [multisine(arm.lower, arm.upper, arm.max_speed, int(rng.integers(2 ** 31)), options,
                         _DURATION, _RATE) for _ in range(_RUNS)]
    runs = [recorded(arm, motion, (), noise, rng) for motion in motions]
    q = rng.uniform(arm.lower, arm.upper, (_POSES, arm.n_joints))
    truth = gravity_torque(arm, q)
    recording = gc.Recording.from_arrays(
        [run.q for run in runs], [run.tau for run in runs], [run.t for run in runs],
        qd=[run.qd for run in runs], names=arm.joints, gate=_GATE)
    torques = [floor(arm, motions, [run.tau for run in runs], noise, q)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.urdf'
        path.write_text(with_other_masses(urdf(name), seed), encoding='utf-8')
        for model in (gc.fit(recording), gc.fit(recording, urdf=path)):
            torques.append(model.predict(q))
    return tuple(100.0 * float(np.sqrt(((torque - truth) ** 2).mean(axis=0)).max() / largest)
                 for torque in torques)  # type: ignore[return-value]


def floor(arm: Arm, motions: list[Motion], tau: list[FloatArray], noise: FloatArray,
          q: FloatArray) -> FloatArray:
    """Return the gravity (K, N) in N·m in poses q of least squares with known dynamics."""
    normal: FloatArray = np.zeros((10 * arm.n_joints, 10 * arm.n_joints))
    right: FloatArray = np.zeros(10 * arm.n_joints)
    for motion, torque in zip(motions, tau):
        columns = regressor(arm, motion) / noise[:, None]
        flat = columns.reshape(-1, columns.shape[2])
        normal += flat.T @ flat
        right += flat.T @ (torque / noise).ravel()
    # Parameters that no torque depends on have the eigenvalue 0.
    x = np.linalg.pinv(normal, rcond=1e-12, hermitian=True) @ right
    still = Motion('poses', np.arange(len(q), dtype=np.float64), q, 0 * q, 0 * q,
                   lambda t: (q, 0 * q, 0 * q))
    return np.asarray(regressor(arm, still) @ x)


if __name__ == '__main__':
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    sys.exit(main())
