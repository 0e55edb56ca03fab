"""
Stated chance of a plan against what the regression finds after it.

    python -m bench.planning.calibrate [results/] --seeds 0-1 --arms iiwa7,six_axis

The size of the effect is drawn from the prior that the plan assumes. A case counts as resolved if
the regression of both recordings has the effect with the gain of the engine's limit and without
alternatives.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
import sys
import time
from typing import Any

from bench.planning.scenes import MORE_SECONDS, POOR, RATE, Scene, slow_sines
from bench.shared.runner import names, Result, run, seeds, table_of
from bench.shared.serial_arms import geometry_of
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import model_of
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.planning.questions import named_targets
from gravity_comp_ros.planning.workspace import PlanOptions
from gravity_comp_ros.simulation import motions
import numpy as np

EFFECTS = ('coulomb_friction', 'viscous_friction', 'torque_offset', 'joint_spring',
           'load_dependent_friction')
_BINS = (0.0, 0.2, 0.5, 0.8, 0.9, 1.0)


def options(parser: ArgumentParser) -> None:
    parser.add_argument('--arms', type=names, default='iiwa7,six_axis')
    parser.add_argument('--effects', type=names, default=','.join(EFFECTS))
    parser.add_argument('--poor', type=names, default=','.join(POOR))
    parser.add_argument('--seeds', type=seeds, default='0-1')
    parser.add_argument('--described', action='store_true', help='with a robot description')


def cases(args: Namespace) -> dict[str, tuple[Any, ...]]:
    scenes = [Scene(arm, effect, 1 + 2 * (seed % 2), poor, seed, described=args.described)
              for seed in args.seeds for effect in args.effects for poor in args.poor
              for arm in args.arms]
    return {scene.name: (scene,) for scene in scenes}


def planned(scene: Scene) -> Result:
    """Return the stated chances of a case, and what was found before and after each motion."""
    result: Result = {'effect': scene.effect, 'poor': scene.poor}
    axes = geometry_of(scene.arm_model) if scene.described else None
    fit, target = FitOptions('chain', geometry=axes), scene.truth
    limits = PlanOptions(MORE_SECONDS)
    try:
        sized = replace(scene, drawn=_size(scene, fit, limits))
        old = sized.recorded()
        estimated = estimate(old, fit)
        model = model_of(estimated)
        started = time.process_time()
        found = plan(old, model, [target], limits, estimated=estimated)
        seconds = time.process_time() - started
        trajectory = found.trajectory
        ways = {'planned': motions.sample('planned', trajectory.at, trajectory.duration, RATE),
                'random': slow_sines(old.q.min(axis=0) - 1e-3, old.q.max(axis=0) + 1e-3,
                                     limits.max_speed, scene.seed)}
        resolved = {
            way: _is_resolved(concatenate([old, sized.later(motion)]), fit, model, target)
            for way, motion in ways.items()}
    except GravityCompError as problem:
        return {**result, 'error': str(problem)}
    return {**result, 'size': sized.drawn, 'plan_seconds': seconds,
            'expected': found.expectations[0].to_json(), 'found': resolved,
            'before': _is_resolved(old, fit, model, target)}


def line(result: Result) -> str:
    return result.get('error') or f'{result["expected"]["chance"]:.2f} {result["found"]}'


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


def table(results: list[Result]) -> str:
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
    sys.exit(run(__doc__, options, cases, planned, line, table))
