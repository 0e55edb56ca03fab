"""
The loop on recordings of real arms: fit, diagnose and add, each tested on later motion.

Run from the root of the repository; an arm's name before its recording adds its known axes:

    python -m bench.real_robots.recordings ur10=ur10.db3 panda=panda.db3 tiago=tiago.csv

Axes are those of the makers' data sheets, of TIAGo those of its description (`arms`). Its table
has motor currents; gear ratios and torque constants are those of its publisher (figaroh-plus), and
the torso lift is left out.

The first 70 % of each recording are fitted and diagnosed, the last 30 % are compared. Errors are
RMSE over the standard deviation of the torque, in percent, joint by joint, with their mean: of
a fit of all samples, and after `add` of the findings. For known axes the loop is repeated with the
arm's description and compared with an independent reference: Pinocchio's regressor with Coulomb
and viscous friction and offset of every joint, by least squares.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import tempfile

from bench.real_robots.arms import data_sheet_urdf, DATA_SHEETS, SOURCES, urdf
import gravity_comp_ros as gc
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.samples import FloatArray, JointSamples
import numpy as np
import pinocchio as pin

# Share of a recording that is fitted.
_FITTED = 0.7
# Velocity scale, in rad/s, of the sign change of the reference's Coulomb friction.
_WIDTH = 0.01
_TIAGO = 'tiago'
# Torque of TIAGo's joints per motor current in N·m/A: torque constant times gear ratio.
_TORQUE_PER_CURRENT = (13.6, 13.6, -8.7, -8.7, -20.5968, -20.5968, -20.5968)


def main() -> int:
    """Run the loop on each recording and print the errors."""
    parser = argparse.ArgumentParser(description='The loop on recordings of real arms.')
    parser.add_argument('bags', nargs='+', metavar='[ARM=]BAG')
    for text in parser.parse_args().bags:
        arm, _, bag = text.rpartition('=')
        if arm and arm not in (*DATA_SHEETS, _TIAGO):
            parser.error(f'no arm {arm}; available: {", ".join((*DATA_SHEETS, _TIAGO))}')
        data = table(Path(bag)) if bag.endswith('.csv') else gc.read(bag)
        t = data.samples.t
        split = t[0] + _FITTED * (t[-1] - t[0])
        early = gc.Recording(data.samples.select(t < split))
        later = gc.Recording(data.samples.select(t >= split), gate=None)
        print(bag)
        loop(early, later, None)
        if arm:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / f'{arm}.urdf'
                path.write_text(urdf(arm) if arm == _TIAGO else data_sheet_urdf(arm, data.joints))
                print('with the description of the arm')
                loop(early, later, path)
                print_shares('reference', reference(path, early.samples, later.samples))
    return 0


def table(path: Path) -> gc.Recording:
    """Return the recording of a table of TIAGo's arm with motor currents in A."""
    with path.open(encoding='utf-8') as stream:
        columns = stream.readline().strip().split(',')
        values = np.loadtxt(stream, delimiter=',')
    joints = SOURCES[_TIAGO].joints
    q, qd, current = (values[:, [columns.index(f'{joint}_{what}') for joint in joints]]
                      for what in ('position', 'velocity', 'effort'))
    scale = dict(zip(joints, _TORQUE_PER_CURRENT))
    return gc.Recording.from_arrays(q, current, values[:, columns.index('t')], qd=qd,
                                    names=joints, effort_scale=scale)


def loop(early: gc.Recording, later: gc.Recording, urdf: Path | None) -> None:
    """Fit, diagnose, add, and print the errors after each."""
    early = gc.Recording(early.samples, gate=None)
    model = gc.fit(early, urdf=urdf)
    show('fit', model, later)
    findings = gc.diagnose(early, model).findings
    for finding in findings:
        print(f'    {finding.effect or "unexplained"} on {finding.joint or "the arm"}: '
              f'{finding.verdict}')
    try:
        model = gc.add_effects(model, early, findings)
    except gc.GravityCompError as problem:
        print(f'    refused: {problem}')
    show('add', model, later)


def show(title: str, model: gc.Model, recording: gc.Recording) -> None:
    """Print the errors of a model."""
    joints = gc.compare(model, recording).joints.values()
    print_shares(title, np.array([100.0 * joint.rmse / max(joint.torque_std, 1e-12)
                                  for joint in joints]))


def print_shares(title: str, shares: FloatArray) -> None:
    print(f'{title}:', ' '.join(f'{share:.0f}' for share in shares), '%, mean',
          f'{shares.mean():.0f} %', flush=True)


def reference(urdf: Path, early: JointSamples, later: JointSamples) -> FloatArray:
    """Return the errors (N,) of rigid-body identification with Pinocchio, in percent."""
    model = pin.buildModelFromUrdf(str(urdf))
    columns, test_columns = (reference_columns(model, part) for part in (early, later))
    size = np.maximum(early.tau.std(axis=0), 0.1)
    flat = (columns / size[:, None]).reshape(-1, columns.shape[2])
    x = np.linalg.lstsq(flat, (early.tau / size).ravel(), rcond=1e-8)[0]
    error = np.sqrt(((later.tau - test_columns @ x) ** 2).mean(axis=0))
    return np.asarray(100.0 * error / later.tau.std(axis=0))


def reference_columns(model: pin.Model, samples: JointSamples) -> FloatArray:
    """Return the regressor (M, N, K) of the reference."""
    data, qdd = model.createData(), accelerations(samples)
    m, n = samples.q.shape
    arm = np.array([pin.computeJointTorqueRegressor(model, data, *row)
                    for row in zip(samples.q, samples.qd, qdd)])
    friction = np.zeros((m, n, 3 * n))
    for joint in range(n):
        qd = samples.qd[:, joint]
        friction[:, joint, 3 * joint:3 * joint + 3] = np.column_stack(
            [np.tanh(qd / _WIDTH), qd, np.ones(m)])
    return np.concatenate([arm, friction], axis=2)


if __name__ == '__main__':
    raise SystemExit(main())
