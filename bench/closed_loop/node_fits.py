"""
Errors of the node's models of an arm in MuJoCo that a controller moves slowly.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.closed_loop.node_fits [--first 0] [--seeds 10]

The recordings, poses and errors are those of `open_loop`, without a description. All joint states
go through `NodeCore`, as fast as it reads them. A fit is requested after 75 s without a load, and
after 15 s and 75 s with 2 kg.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
import time

from bench.closed_loop.arm import BUILDS, MujocoArm, SlowPath
from bench.closed_loop.open_loop import box_poses, error, LOAD, record
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'test'))
# Start of the stamps and pause between two parts, s.
START, PAUSE = 1.0, 0.01


class Replay:
    """A node without ROS that receives samples as joint states."""

    def __init__(self) -> None:
        self.node = NodeCore(Parameters(unlimited_torque=True, settle_time=0.0, auto_fit=False),
                             '/joint_states', 0.0)
        self.now = START

    def play(self, samples: JointSamples) -> None:
        """Send samples after those before."""
        from node_messages import joint_state, send_message
        for t, q, qd, tau in zip(samples.t - samples.t[0] + self.now, samples.q, samples.qd,
                                 samples.tau):
            send_message(self.node, joint_state(samples.names, float(t), q, qd, tau), float(t))
        self.now += float(samples.t[-1] - samples.t[0]) + PAUSE

    def fitted(self):
        """Return the model in use after a fit of the samples since the payload changed."""
        from node_messages import until
        until(self.node, lambda: self.node.learner.fits.state == 'ready')
        replies: list[tuple[bool, str]] = []
        self.node.refit(time.monotonic(), lambda *reply: replies.append(reply))
        until(self.node, lambda: replies)
        if not replies[0][0]:
            print(f'       refused: {replies[0][1]}', flush=True)
        return self.node.models.model


def measure(build: str, seed: int) -> list[float]:
    """Return the errors of one arm and one path in N·m, nan without a model."""
    bare, loaded = MujocoArm(build, None, seed), MujocoArm(build, LOAD, seed + 100)
    path = SlowPath.random(len(bare.joints), seed)
    first, second = record(bare, path, 0.0, 75.0), record(loaded, path, 75.0, 75.0)
    poses, replay = box_poses(first), Replay()
    try:
        replay.play(first)
        models = [(replay.fitted(), bare)]
        replay.node.payload_changed(replay.now)
        for part in (second.t < 90.0, second.t >= 90.0):
            replay.play(second.select(part))
            models.append((replay.fitted(), loaded))
    finally:
        replay.node.close()
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
