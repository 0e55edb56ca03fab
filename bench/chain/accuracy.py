"""
Accuracy of the chain: on the motion, over the joint range, after a tool change, on other arms.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.chain.accuracy iiwa arms rough tool short [--seeds 10]

Errors are RMSE of the worst joint in N·m against noise-free gravity. `motion` is 100 s of the
training motion's continuation, `range` 1000 poses over all joint limits. `in` and `out` are the
shares of torques, measured with the same noise, inside the 95 % band on `motion` and `range`,
over all joints and seeds; `true` are those of the noise-free torques inside the model's 95 % band.
The floor is a fit of all moments with the true axes. `rough` has inertia, Coulomb friction and
noise of 0.3 N·m, with and without friction as an effect; `tool` estimates a payload of 2 kg with a
URDF; `short` are the generated arms after 20 and 12 s of motion.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
import time

from bench.cases import generated
from bench.estimator.builds import fit_on_axes, NOISE, true_axes
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.urdf import parse_urdf
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.simulation import arms, motions
import numpy as np

# Coulomb friction and noise of `rough`, in N·m.
ROUGH = 0.3
URDF = Path(__file__).resolve().parents[2] / 'bags' / 'iiwa7.urdf'
Row = dict[str, float]
PAYLOADS = {'on axis': (0.0, 0.0, 0.1), 'off axis': (0.02, 0.03, 0.1)}


@dataclass
class Case:
    """An arm with its training motion and the test poses."""

    arm: arms.Arm
    path: object
    seed: int

    def __post_init__(self) -> None:
        self.motion = self.path(start=100.0).q
        self.range = np.random.default_rng(1234).uniform(
            self.arm.lower, self.arm.upper, (1000, self.arm.n_joints))

    def samples(self, arm: arms.Arm, stream: int, **when) -> JointSamples:
        motion = self.path(**when)
        rng = np.random.default_rng([self.seed, stream])
        tau = arms.gravity_torque(arm, motion.q)
        return JointSamples.single_run(arm.joints, motion.t, motion.q, np.zeros_like(motion.q),
                                       tau + NOISE * rng.normal(size=tau.shape))

    def errors(self, model: GravityModel, arm: arms.Arm, noise: float = NOISE) -> Row:
        row = {}
        for name, q in (('motion', self.motion), ('range', self.range)):
            error = model.predict(q) - arms.gravity_torque(arm, q)
            std = model.predict_std(q)
            measured = error + noise * np.random.default_rng(5).normal(size=error.shape)
            row[name] = float(np.sqrt((error ** 2).mean(axis=0)).max())
            row[f'band_{name}'] = float(
                (np.abs(measured) <= 1.96 * np.hypot(std, model.noise)).mean())
            row[f'true_{name}'] = float((np.abs(error) <= 1.96 * std + 1e-9).mean())
        return row

    def floor(self, samples: JointSamples) -> Row:
        """Return the errors of a least-squares fit of all moments with the true axes."""
        chain = fit_on_axes(true_axes(self.arm), samples)
        return {name: float(np.sqrt(((chain.torque(q) - arms.gravity_torque(self.arm, q)) ** 2)
                                    .mean(axis=0)).max())
                for name, q in (('motion', self.motion), ('range', self.range))}


def show(title: str, rows: list[Row]) -> None:
    """Print the worst and the mean of the errors."""
    def column(key: str) -> np.ndarray:
        return np.array([row[key] for row in rows])
    print(f'{title:26s} motion {column("motion").max():6.3f} (mean {column("motion").mean():.3f})'
          f'  range {column("range").max():6.3f} (mean {column("range").mean():.3f})'
          f'  band in {column("band_motion").mean():.3f} out {column("band_range").mean():.3f}'
          f'  true in {column("true_motion").mean():.2f} out {column("true_range").mean():.2f}'
          f'  s {column("seconds").max():.2f}', flush=True)


def fitted(case: Case, samples: JointSamples, formulation: str) -> tuple[GravityModel, Row]:
    """Return a fit with its errors and time."""
    start = time.perf_counter()
    model = fit(samples, FitOptions(formulation)).model
    seconds = time.perf_counter() - start
    return model, {**case.errors(model, case.arm), 'seconds': seconds}


def updated(case: Case, loaded: arms.Arm, model: GravityModel, new: JointSamples) -> Row:
    """Return errors and time of an update of the model on the loaded arm."""
    start = time.perf_counter()
    result = update(model, new).model
    seconds = time.perf_counter() - start
    return {**case.errors(result, loaded), 'seconds': seconds}


def iiwa(seeds: int, formulation: str) -> None:
    """Measure on the iiwa and Yu 2022, Eq. (17), with and without 2 kg."""
    rows: dict[str, list[Row]] = {}
    floors = []
    for seed in range(seeds):
        case = Case(arms.iiwa7(), motions.eq17, seed)
        samples = case.samples(case.arm, 0)
        model, row = fitted(case, samples, formulation)
        rows.setdefault('500 samples', []).append(row)
        floors.append(case.floor(samples))
        for name, com in PAYLOADS.items():
            loaded = arms.with_payload(case.arm, arms.Payload(2.0, com))
            for stream, count in enumerate((50, 25), start=1):
                new = case.samples(loaded, stream, start=100.0, duration=count / 5)
                rows.setdefault(f'2 kg {name}, {count}', []).append(
                    updated(case, loaded, model, new))
    print(f'iiwa, {formulation}, {seeds} seeds; floor motion '
          f'{max(f["motion"] for f in floors):.3f} range {max(f["range"] for f in floors):.3f}')
    for title, group in rows.items():
        show(title, group)


def generated_arms(seeds: int, formulation: str) -> None:
    """Measure on generated arms, and compare with the floor."""
    for right in (False, True):
        rows: dict[str, list[Row]] = {}
        for seed in range(seeds):
            arm = generated.generated_arm(seed, right_angles=right)
            case = Case(arm, lambda a=arm, s=seed, **when: generated.small_motion(a, s, **when),
                        seed)
            samples = case.samples(arm, 0)
            model, row = fitted(case, samples, formulation)
            floor = case.floor(samples)
            loaded = arms.with_payload(arm, arms.Payload(1.0, (0.02, 0.03, 0.1)))
            new = case.samples(loaded, 1, start=100.0, duration=10.0)
            after = updated(case, loaded, model, new)
            rows.setdefault('500 samples', []).append(row)
            rows.setdefault('1 kg, 50', []).append(after)
            print(f'  arm {seed} ({arm.n_joints} axes): motion {row["motion"]:.3f} = '
                  f'{row["motion"] / floor["motion"]:.1f} floors, range {row["range"]:.3f} = '
                  f'{row["range"] / floor["range"]:.1f} floors; 1 kg, 50 samples: motion '
                  f'{after["motion"]:.3f} range {after["range"]:.3f} band '
                  f'{after["band_range"]:.2f}', flush=True)
        print(f'generated arms, {"right angles" if right else "any angles"}, {formulation}')
        for title, group in rows.items():
            show(title, group)


def rough(seeds: int, formulation: str) -> None:
    """Measure on an iiwa with inertia, Coulomb friction and noise of 0.3 N·m."""
    rows: dict[str, list[Row]] = {}
    for seed in range(seeds):
        case = Case(arms.iiwa7(), motions.eq17, seed)
        motion = motions.eq17()
        tau = arms.inverse_dynamics(case.arm, motion.q, motion.qd, motion.qdd)
        tau += ROUGH * np.tanh(motion.qd / 0.002)
        tau += ROUGH * np.random.default_rng([seed, 7]).normal(size=tau.shape)
        samples = JointSamples.single_run(case.arm.joints, motion.t, motion.q, motion.qd, tau)
        effects = [f'coulomb_friction:{name}' for name in samples.names]
        for name in ('friction unknown', 'friction an effect'):
            start = time.perf_counter()
            options = FitOptions(formulation)
            model = fit(samples, options,
                        effects=() if name.endswith('unknown') else effects).model
            seconds = time.perf_counter() - start
            rows.setdefault(name, []).append(
                {**case.errors(model, case.arm, ROUGH), 'seconds': seconds})
    print(f'iiwa with Coulomb friction and noise of {ROUGH} N·m, {formulation}, {seeds} seeds')
    for title, group in rows.items():
        show(title, group)


def tool(seeds: int, formulation: str) -> None:
    """Estimate a payload of 2 kg from 50 and 25 samples, after a fit without a URDF."""
    geometry = parse_urdf(URDF.read_bytes(), arms.iiwa7().joints)
    rows: dict[str, list[Row]] = {}
    errors: dict[str, list[np.ndarray]] = {}
    for seed in range(seeds):
        case = Case(arms.iiwa7(), motions.eq17, seed)
        model = fit(case.samples(case.arm, 0), FitOptions(formulation)).model
        for name, com in PAYLOADS.items():
            loaded = arms.with_payload(case.arm, arms.Payload(2.0, com))
            for stream, count in enumerate((50, 25), start=1):
                new = case.samples(loaded, stream, start=100.0, duration=count / 5)
                start = time.perf_counter()
                result = update(model, new, geometry=geometry)
                seconds = time.perf_counter() - start
                title, payload = f'2 kg {name}, {count}', result.report.payload
                rows.setdefault(title, []).append(
                    {**case.errors(result.model, loaded), 'seconds': seconds})
                centre = [payload.centre[axis].value for axis in 'xyz']
                errors.setdefault(title, []).append(np.abs(np.array(
                    [100 * (payload.mass.value / 2.0 - 1), *1e3 * (centre - np.array(com))])))
    print(f'iiwa, {formulation}, update with a URDF, {seeds} seeds')
    for title, group in rows.items():
        show(title, group)
        worst = np.max(errors[title], axis=0)
        print(f'{"":26s} mass within {worst[0]:.2f} %, centre within {worst[1:].max():.1f} mm')


def short(seeds: int, formulation: str) -> None:
    """Measure on generated arms after insufficient motion."""
    for duration in (20.0, 12.0):
        rows, warned = [], 0
        for seed in range(seeds):
            for right in (False, True):
                arm = generated.generated_arm(seed, right_angles=right)
                case = Case(arm, lambda a=arm, s=seed, **when: generated.small_motion(
                    a, s, **when), seed)
                start = time.perf_counter()
                result = fit(case.samples(arm, 0, duration=duration), FitOptions(formulation))
                seconds = time.perf_counter() - start
                rows.append({**case.errors(result.model, arm), 'seconds': seconds})
                warned += any('may be off by' in text for text in result.report.warnings)
        print(f'generated arms, {duration:.0f} s, {formulation}; {warned} of {len(rows)} warn of '
              f'uncertainty; worst band {min(row["band_range"] for row in rows):.2f}')
        show(f'{duration:.0f} s', rows)


PARTS = {'iiwa': iiwa, 'arms': generated_arms, 'rough': rough, 'tool': tool, 'short': short}


def main() -> None:
    """Run the named parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('parts', nargs='+', choices=tuple(PARTS))
    parser.add_argument('--seeds', type=int, default=10)
    parser.add_argument('--formulation', default='chain')
    args = parser.parse_args()
    for part in args.parts:
        PARTS[part](args.seeds, args.formulation)


if __name__ == '__main__':
    main()
