"""
First trial of a new user: two simulated recordings with friction and a spring, fit and diagnose.

Run from the root of the repository:

    python -m bench.real_robots.new_user

It records a multisine of 90 s at 50 Hz with 0.1 N·m of noise, Coulomb friction of 0.8 N·m on
joint 4 and a spring on joint 2 (`gravity_comp synth`, seeds 5 and 6 as two runs, 7 held out), and
prints the error of the predicted torque at rest against the simulated arm with its spring, the
findings, and the held-out errors before and after `add`. The poses of seed 7 are outside the
trained ones: joints 2 and 4 move where they have not been.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
import sys
import tempfile

from bench.real_robots.product import static_part
import gravity_comp_ros as gc
from gravity_comp_ros.cli import main as gravity_comp
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, iiwa7
from gravity_comp_ros.simulation.hidden import hidden
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np

_SPRING = 'joint_spring:iiwa_joint_2'
_OPTIONS = ['--motion', 'multisine', '--duration', '90', '--rate', '50', '--noise', '0.1',
            '--hidden', 'coulomb_friction:iiwa_joint_4=0.8', '--hidden', _SPRING]


def main() -> int:
    """Run the trial and print its figures."""
    with tempfile.TemporaryDirectory() as folder:
        bags = [synthesised(Path(folder), seed) for seed in (5, 6, 7)]
        return trial(gc.read(bags[:2]), gc.read(bags[2:]))


def trial(train: gc.Recording, held_out: gc.Recording) -> int:
    """Run the loop and print the errors after each step."""
    model = gc.fit(train)
    arm, box = iiwa7(), train.slow.q
    q = np.random.default_rng(0).uniform(box.min(axis=0), box.max(axis=0), (1000, arm.n_joints))
    print('errors in N·m, joints 1 to 7')
    for poses, where in ((box, 'in the training poses'), (q, 'in the trained box')):
        show(f'fit, torque at rest {where}',
             static_part(model, arm.joints, poses) - held_up(arm, poses))
    errors('fit, held-out', model, held_out)
    for warning in model.warnings:
        print(f'warning: {warning}')
    diagnosis = gc.diagnose(train, model)
    print(diagnosis)
    try:
        model = gc.add_effects(model, train, diagnosis.findings)
    except gc.GravityCompError as problem:
        print(f'add: {problem}')
        return 0
    print(f'added: {", ".join(model.effects)}')
    show('add, torque at rest in the trained box',
         static_part(model, arm.joints, q) - held_up(arm, q))
    errors('add, held-out', model, held_out)
    return 0


def held_up(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the torque (K, N) in N·m that holds the arm with its spring in poses q (K, N)."""
    motion = Motion('poses', np.arange(float(len(q))), q, 0 * q, 0 * q,
                    lambda t: (q, 0 * q, 0 * q))
    return synthesise(arm, motion, SynthesisOptions(
        static=True, disturbances=[hidden(_SPRING, arm).disturbance])).tau


def synthesised(folder: Path, seed: int) -> Path:
    """Return a recording written by `gravity_comp synth`."""
    path = folder / f'{seed}.mcap'
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        code = gravity_comp(['synth', '-o', str(path), '--seed', str(seed), *_OPTIONS])
    if code:
        raise SystemExit(f'synth failed: {output.getvalue()}')
    return path


def show(title: str, error: FloatArray) -> None:
    """Print rms and largest error (M, N) of each joint."""
    for kind, values in (('rms', np.sqrt((error ** 2).mean(axis=0))),
                         ('largest', np.abs(error).max(axis=0))):
        print(f'{title}, {kind}:', ' '.join(f'{x:.3f}' for x in values))


def errors(title: str, model: gc.Model, recording: gc.Recording) -> None:
    """Print the rms error of each joint on a recording."""
    joints = gc.compare(model, recording).joints.values()
    print(f'{title}, rms:', ' '.join(f'{joint.rmse:.3f}' for joint in joints))


if __name__ == '__main__':
    sys.exit(main())
