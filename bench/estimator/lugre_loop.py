"""
Accuracy of the whole loop on arms with LuGre friction in every joint, relative to an oracle.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.estimator.lugre_loop [--seeds 10] [--arms NAME ...]

Five runs of 150 s at 50 Hz are fitted and diagnosed, and all established and likely effects are
added (`ambiguous`: the first of each ambiguous pair as well). Errors are RMSE of the torque on a
sixth run. The oracle has the true rigid-body dynamics. Its friction, presliding bristles with the
best slip distance, viscous friction and an offset, is fitted by least squares to the same runs.
Arms and friction levels are those of the campaign's test case `friction`.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import time

from bench.campaign.judging import judging_case
from bench.cases.cases import ARMS, recordings
import gravity_comp_ros as gc
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.simulation.arms import Arm, inverse_dynamics
from gravity_comp_ros.simulation.disturbances.friction import deflection
import numpy as np

_TRAINING_RUNS = 5
# Candidate deflections, in rad, at which the oracle's bristles slip.
_SLIPS = np.logspace(-5.0, -2.0, 25)


def measure(arm: str, seed: int) -> dict[str, FloatArray]:
    """Return the errors (N,) in N·m on the held-out run."""
    case = replace(judging_case(arm, 'friction', seed), runs=_TRAINING_RUNS + 1)
    samples = recordings(case, seed)
    training = samples.runs < _TRAINING_RUNS
    train, test = samples.select(training), samples.select(~training)
    begun = time.process_time()
    model = gc.fit(gc.Recording(train))
    findings = gc.diagnose(gc.Recording(train, gate=None), model).findings
    accepted = [f for f in findings if f.verdict in (gc.Verdict.ESTABLISHED, gc.Verdict.LIKELY)]
    ambiguous = [f for f in findings if f.verdict == gc.Verdict.AMBIGUOUS and f.effect]
    errors = {'fit': error(model, test)}
    for name, chosen in (('loop', accepted), ('ambiguous', [*accepted, *ambiguous])):
        targets = [target(f.effect, f.joint) for f in chosen if f.effect]
        added = gc.add_effects(model, gc.Recording(train), targets) if targets else model
        errors[name] = error(added, test)
    errors['seconds'] = np.array([time.process_time() - begun])
    errors['oracle'] = oracle(ARMS[arm](), train, test)
    return errors


def error(model: gc.Model, test: JointSamples) -> FloatArray:
    """Return each joint's RMSE (N,) of a model, from `compare`."""
    joints = gc.compare(model, gc.Recording(test, gate=None)).joints.values()
    return np.array([joint.rmse for joint in joints])


def oracle(arm: Arm, train: JointSamples, test: JointSamples) -> FloatArray:
    """Return the errors (N,) of the true dynamics with fitted friction."""
    residuals = [part.tau - inverse_dynamics(arm, part.q, part.qd, accelerations(part))
                 for part in (train, test)]
    errors = np.empty(arm.n_joints)
    for joint in range(arm.n_joints):
        trials = []
        for slip in _SLIPS:
            columns = [friction(part, joint, slip) for part in (train, test)]
            x = np.linalg.lstsq(columns[0], residuals[0][:, joint], rcond=None)[0]
            rmse = [float(np.sqrt(((tau[:, joint] - a @ x) ** 2).mean()))
                    for tau, a in zip(residuals, columns)]
            trials.append((rmse[0], rmse[1]))
        errors[joint] = min(trials)[1]
    return errors


def friction(samples: JointSamples, joint: int, slip: float) -> FloatArray:
    """Return columns (M, 3): bristle deflection relative to slip, velocity, offset."""
    bristles = np.concatenate([deflection(np.diff(samples.q[run, joint]), np.full(1, slip))
                               for run in run_slices(samples)]) / slip
    return np.column_stack([bristles, samples.qd[:, joint], np.ones(len(bristles))])


def main() -> None:
    """Measure and print a line for each case and a summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=10)
    parser.add_argument('--arms', nargs='+', default=list(ARMS))
    args = parser.parse_args()
    worst: dict[str, list[float]] = {'fit': [], 'loop': [], 'ambiguous': []}
    for arm in args.arms:
        for seed in range(args.seeds):
            rows = measure(arm, seed)
            ratios = {name: rows[name] / rows['oracle'] for name in worst}
            for name, ratio in ratios.items():
                worst[name].append(float(ratio.max()))
            print(f'{arm:12s} {seed}: ' + ', '.join(
                f'{name} {ratio.max():.3f} (joint {ratio.argmax() + 1})'
                for name, ratio in ratios.items()) + f', {rows["seconds"][0]:.1f} s', flush=True)
    for name, values in worst.items():
        print(f'{name}: worst joint, multiples of the oracle: median {np.median(values):.3f}, '
              f'worst {max(values):.3f}, above 1.25 in {np.mean(np.array(values) > 1.25):.0%}')


if __name__ == '__main__':
    main()
