"""
Stated chance of a plan against what the regression finds after it.

    python -m bench.planning.calibrate results.jsonl --seeds 0,1 --arms iiwa7,six_axis

The size of the effect is drawn from the prior that the plan assumes. A case counts as resolved if
the regression of both recordings has the effect with the gain of the engine's limit and without
alternatives.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import json
from pathlib import Path
import sys
import time
from typing import Any

from bench.planning.scenes import MORE_SECONDS, RATE, Scene, slow_sines
from bench.shared.serial_arms import geometry_of
from bench.shared.stored import table as table_of
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import model_of
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning import plan, PlanOptions
from gravity_comp_ros.planning.questions import named_targets
from gravity_comp_ros.simulation import motions
import numpy as np

EFFECTS = ('coulomb_friction', 'viscous_friction', 'torque_offset', 'joint_spring',
           'load_dependent_friction')
_BINS = (0.0, 0.2, 0.5, 0.8, 0.9, 1.0)


def main() -> int:
    """Run the cases, append their results, and print the table of all in the file."""
    out = argparse.ArgumentParser(description='Calibration of the stated chance.')
    out.add_argument('results', help='file of JSON lines')
    out.add_argument('--arms', default='iiwa7,six_axis')
    out.add_argument('--effects', default=','.join(EFFECTS))
    out.add_argument('--poor', default='one_way,one_speed,narrow,one_posture')
    out.add_argument('--seeds', default='0,1')
    out.add_argument('--described', action='store_true', help='with a robot description')
    out.add_argument('--minutes', type=float, default=1e9, help='start no case after this time')
    args = out.parse_args()
    path = Path(args.results)
    deadline = time.monotonic() + 60.0 * args.minutes
    for seed in map(int, args.seeds.split(',')):
        for effect in args.effects.split(','):
            for poor in args.poor.split(','):
                for arm in args.arms.split(','):
                    if time.monotonic() > deadline:
                        continue
                    scene = Scene(arm, effect, 1 + 2 * (seed % 2), poor, seed,
                                  described=args.described)
                    with path.open('a') as file:
                        file.write(json.dumps(run(scene)) + '\n')
    print(table([json.loads(line) for line in path.read_text().splitlines()]))
    return 0


def run(scene: Scene) -> dict[str, Any]:
    """Return the stated chances of a case, and what was found before and after each motion."""
    result: dict[str, Any] = {'name': scene.name, 'effect': scene.effect, 'poor': scene.poor}
    axes = geometry_of(scene.arm_model) if scene.described else None
    options, target = FitOptions('chain', geometry=axes), scene.truth
    limits = PlanOptions(MORE_SECONDS)
    try:
        sized = replace(scene, drawn=_size(scene, options, limits))
        old = sized.recorded()
        estimated = estimate(old, options)
        model = model_of(estimated)
        started = time.process_time()
        planned = plan(old, model, [target], limits, estimated=estimated)
        seconds = time.process_time() - started
        expected = planned.expectations[0]
        trajectory = planned.trajectory
        ways = {'planned': motions.sample('planned', trajectory.at, trajectory.duration, RATE),
                'random': slow_sines(old.q.min(axis=0) - 1e-3, old.q.max(axis=0) + 1e-3,
                                     limits.max_speed, scene.seed)}
        resolved = {
            way: _is_resolved(concatenate([old, sized.later(motion)]), options, model, target)
            for way, motion in ways.items()}
    except GravityCompError as problem:
        return {**result, 'error': str(problem)}
    return {**result, 'size': sized.drawn, 'plan_seconds': seconds,
            'expected': expected.to_json(), 'found': resolved,
            'before': _is_resolved(old, options, model, target)}


def _size(scene: Scene, options: FitOptions, limits: PlanOptions) -> float:
    """Return a size drawn from the prior that a plan assumes without the effect."""
    old = replace(scene, drawn=1e-9).recorded()
    estimated = estimate(old, options)
    planned = plan(old, model_of(estimated), [scene.truth], limits,
                   estimated=estimated)
    std = next(iter(planned.expectations[0].assumed.values()))
    return float(abs(std * np.random.default_rng([scene.seed, 7]).standard_normal()))


def _is_resolved(samples: JointSamples, options: FitOptions, model: GravityModel,
                 target: str) -> bool:
    regression = estimate(samples, options, old=model).regression
    (key,) = named_targets([target], samples.names)
    return key in regression.gains and not regression.alternatives[key]


def table(results: list[dict[str, Any]]) -> str:
    """Return the counts by poor recording, and the calibration of the chance."""
    done = [r for r in results if 'found' in r]
    rows = []
    for poor in dict.fromkeys(r['poor'] for r in done):
        here = [r for r in done if r['poor'] == poor]
        stated = sum(r['expected']['chance'] for r in here)
        rows.append((poor, len(here), sum(r['before'] for r in here), f'{stated:.1f}',
                     *(sum(r['found'][way] for r in here) for way in ('planned', 'random'))))
    chances = []
    for low, high in zip(_BINS, _BINS[1:]):
        pairs = [(r['expected']['chance'], r['found']['planned']) for r in done
                 if low <= r['expected']['chance'] < high or r['expected']['chance'] == high == 1]
        if pairs:
            stated, rate = np.mean(pairs, axis=0)
            chances.append((f'{low:.0%} to {high:.0%}', len(pairs), f'{stated:.0%}',
                            f'{rate:.0%}'))
    return '\n'.join([
        f'{len(results) - len(done)} cases without a plan',
        table_of(('recording', 'cases', 'resolved before', 'stated', 'planned', 'random'),
                 rows), '',
        table_of(('stated chance', 'cases', 'mean stated', 'resolved'), chances)])


if __name__ == '__main__':
    sys.exit(main())
