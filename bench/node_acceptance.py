"""
Acceptance of models of real payloads and of broken effort after a payload change, without ROS.

    python3 -m bench.node_acceptance [--seeds 3] [--samples 40 100 300] [--base potential chain]
        [--axes] [--real] [--broken]

A model of the bare iiwa (100 s of slow motion, 0.1 N·m of noise) is in use. Then the arm carries a
payload, and slow samples are recorded at 5 Hz. `run_fit` of the fit process fits and tests them.
Real: payloads of 0.3 to 5 kg, on and off the axis. Broken: each of `shared.broken_effort` on
a payload of 2 kg. The error of the model in use is that of its torque on the motion that follows.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import time

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.description.urdf import parse_urdf
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.epoch import DELAYS, Epoch, SlowSample
from gravity_comp_ros.node.job_messages import FitJob, FitResult
from gravity_comp_ros.node.jobs import run_fit
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17, Motion, multisine, MultisineOptions
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RATE, NOISE = 5.0, 0.1
MASSES = (0.3, 0.5, 1.0, 2.0, 3.0, 5.0)
ARM = iiwa7()
# Torque error above which an accepted model is wrong, N·m.
WRONG = 2.0


@dataclass(frozen=True)
class Case:
    """Samples of one payload, and poses and true torque of the motion that follows."""

    label: str
    samples: JointSamples
    later: FloatArray
    truth: FloatArray


def motion(kind: str, seed: int, seconds: float, start: float) -> Motion:
    """Return slow motion: Eq. (17) of Yu 2022, or a multisine."""
    if kind == 'eq17':
        return eq17(seconds, RATE, start)
    return multisine(0.6 * ARM.lower, 0.6 * ARM.upper, ARM.max_speed, seed,
                     MultisineOptions(max_speed=0.14), seconds, RATE, start)


def recorded(kind: str, seed: int, seconds: float, start: float, payload: Payload | None,
             label: str, rng: np.random.Generator) -> Case:
    """Return the measurements of a motion, and the truth of the next ten seconds."""
    arm = ARM if payload is None else with_payload(ARM, payload)
    whole = motion(kind, seed, seconds + 10.0, start)
    n = round(seconds * RATE)
    tau = gravity_torque(arm, whole.q)
    samples = JointSamples.single_run(arm.joints, whole.t[:n], whole.q[:n], whole.qd[:n],
                                      tau[:n] + NOISE * rng.standard_normal((n, 7)))
    return Case(label, samples, whole.q[n:], tau[n:])


def payload_of(seed: int) -> Payload:
    """Return a payload of 0.3 to 5 kg, every other one off the axis."""
    rng = np.random.default_rng(seed)
    side = rng.uniform(-0.15, 0.15, 2) if seed % 2 else (0.0, 0.0)
    return Payload(MASSES[seed % len(MASSES)], (*side, rng.uniform(0.05, 0.2)))


def job_of(case: Case, base: GravityModel, geometry: Geometry | None = None) -> FitJob:
    """Return the fit job that the node submits for these samples."""
    epoch = Epoch(1, case.samples.names, Parameters(sample_rate=RATE), has_base=True)
    none = np.full((len(DELAYS), case.samples.n_joints), np.nan)
    for row in zip(case.samples.t, case.samples.q, case.samples.qd, case.samples.tau):
        epoch.offer(SlowSample(CompleteReading(*row), none))
    return FitJob(epoch.rows(), base, base, geometry=geometry)


def outcome(case: Case, base: GravityModel, geometry: Geometry | None) -> FitResult | str:
    try:
        return run_fit(job_of(case, base, geometry))
    except GravityCompError as problem:
        return str(problem)


def broken_cases(kind: str, seeds: int, n: int) -> Iterator[Case]:
    from bench.shared.broken_effort import KINDS
    for name, corrupt in KINDS.items():
        for seed in range(seeds):
            rng = np.random.default_rng(1000 + seed)
            start = 50.0 + 37.0 * seed
            case = recorded(kind, seed, n / RATE, start, Payload(2.0), name, rng)
            tau = corrupt(case.samples.tau, rng)
            samples = JointSamples.single_run(case.samples.names, case.samples.t,
                                              case.samples.q, case.samples.qd, tau)
            yield Case(f'{name}, seed {seed}', samples, case.later, case.truth)


def real_cases(kind: str, seeds: int, n: int) -> Iterator[Case]:
    for seed in range(seeds):
        payload = payload_of(seed)
        label = f'{payload.mass:g} kg at {np.round(payload.com, 2).tolist()}, seed {seed}'
        yield recorded(kind, seed, n / RATE, 60.0 + 23.0 * seed, payload, label,
                       np.random.default_rng(seed))


def evaluate(case: Case, base: GravityModel, geometry: Geometry | None,
             n: int) -> tuple[bool, float]:
    """Print and return whether a model was accepted, and the error of the model then in use."""
    start = time.monotonic()
    result = outcome(case, base, geometry)
    seconds = time.monotonic() - start
    accepted = isinstance(result, FitResult) and result.accepted
    model = result.model if isinstance(result, FitResult) and accepted else base
    error = float(np.sqrt(((model.predict(case.later) - case.truth) ** 2).mean(axis=0)).max())
    reason = result.reason if isinstance(result, FitResult) else result
    print(f'{n:4} samples {"accepted" if accepted else "refused "} {error:7.2f} N·m '
          f'{seconds:5.1f} s {case.label}: {reason}', flush=True)
    return accepted, error


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--samples', type=int, nargs='+', default=[40, 100, 300])
    parser.add_argument('--base', nargs='+', default=['potential', 'chain'])
    parser.add_argument('--motions', nargs='+', default=['eq17', 'multisine'])
    parser.add_argument('--axes', action='store_true', help='the axes are known (URDF)')
    parser.add_argument('--real', action='store_true')
    parser.add_argument('--broken', action='store_true')
    args = parser.parse_args()
    urdf = (ROOT / 'bags' / 'iiwa7.urdf').read_bytes()
    geometry = parse_urdf(urdf, ARM.joints) if args.axes else None
    for kind in args.motions:
        bare = recorded(kind, 0, 100.0, 0.0, None, 'bare', np.random.default_rng(5))
        for formulation in args.base:
            base = fit(bare.samples, FitOptions(formulation=formulation)).model
            print(f'# {kind}, base {formulation}, axes {"known" if args.axes else "unknown"}')
            for n in args.samples:
                if args.real or not args.broken:
                    results = [evaluate(case, base, geometry, n)
                               for case in real_cases(kind, args.seeds, n)]
                    print(f'# real, {n} samples: {sum(a for a, _ in results)} of {len(results)} '
                          f'accepted, worst error then {max(e for _, e in results):.2f} N·m')
                if args.broken or not args.real:
                    results = [evaluate(case, base, geometry, n)
                               for case in broken_cases(kind, args.seeds, n)]
                    wrong = [e for a, e in results if a and e > WRONG]
                    print(f'# broken, {n} samples: {sum(a for a, _ in results)} of '
                          f'{len(results)} accepted, {len(wrong)} of them over {WRONG:g} N·m '
                          'wrong')


if __name__ == '__main__':
    main()
