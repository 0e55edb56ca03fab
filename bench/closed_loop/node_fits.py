"""
Errors of the node's models of an arm in MuJoCo that a controller moves slowly.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.closed_loop.node_fits [--first 0] [--seeds 10]

An error is the RMS error of gravity of the worst joint at 1000 poses within the range of the
motion, without a description. All joint states go through `NodeCore`, as fast as it reads them. A
fit is requested after 75 s without a load, and after 15 s and 75 s with 2 kg.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.closed_loop.arm import (
    box_poses, BUILDS, error, LOAD, MujocoArm, record, SlowPath)
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
# Pause between two parts, s.
PAUSE = 0.01


def fitted(node: NodeCore):
    """Return the model in use after a fit of the samples since the payload changed."""
    from bench.shared.node_messages import refit
    success, text = refit(node)
    if not success:
        print(f'       refused: {text}', flush=True)
    return node.models.model


def measure(build: str, seed: int) -> list[float]:
    """Return the errors of one arm and one path in N·m, nan without a model."""
    from bench.shared.node_messages import play
    bare, loaded = MujocoArm(build, None, seed), MujocoArm(build, LOAD, seed + 100)
    path = SlowPath.random(len(bare.joints), seed)
    first, second = record(bare, path, 0.0, 75.0), record(loaded, path, 75.0, 75.0)
    poses = box_poses(first)
    settings = Parameters(unlimited_torque=True, settle_time=0.0, auto_fit=False, max_age=0.0)
    node = NodeCore(settings, '/joint_states', 0.0)
    try:
        now = play(node, first)
        models = [(fitted(node), bare)]
        node.learner.payload_changed(now)
        for part in (second.t < 90.0, second.t >= 90.0):
            now = play(node, second.select(part), now + PAUSE)
            models.append((fitted(node), loaded))
    finally:
        node.close()
    return [np.nan if model is None else error(model, arm, poses) for model, arm in models]


def main() -> None:
    """Measure, and print worst and median of each build."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--seeds', type=int, default=10, help='first seed not used')
    parser.add_argument('--build', nargs='+', default=list(BUILDS))
    args = parser.parse_args()
    for build in args.build:
        rows = np.array([measure(build, seed) for seed in range(args.first, args.seeds)])
        print(f'{build:6s}', ', '.join(
            f'{name} worst {column.max():.3f} median {np.median(column):.3f}'
            for name, column in zip(('no load', '2 kg 15 s', '2 kg 75 s'), rows.T)), flush=True)
        print('       ', rows.round(3).tolist(), flush=True)


if __name__ == '__main__':
    main()
