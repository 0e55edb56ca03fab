"""
Planned motion compared with random motion and Fourier series, for open effects of poor recordings.

Run from the root of the repository; stored results are not repeated:

    python -m bench.planning.run results.jsonl --arms iiwa7,six_axis --seeds 0,1
    python -m bench.planning.table results.jsonl

Effects that are too small for any motion of 20 s to show are left out.

Each case is an arm with one hidden effect and a poor recording of 60 s. If its diagnosis is not
right, another motion is added: a plan of 20 s or 7 s near recorded poses, a plan of 20 s in the
middle half of the joints' range, or 20 s of slow random motion of all joints, of three joints near
recorded poses, of all joints in that middle half, or of a D-optimal Fourier series. The result is
right if the diagnosis of both recordings finds the effect on its joint, established or likely, and
no other effect there. Targets of the plan are all open effects; of an ambiguous pair, the hidden
effect.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
import sys
import time
from typing import Any

from bench.campaign.score import ALWAYS_THERE
from bench.planning.baselines import (
    fourier, MORE_SECONDS, played, random_near, random_slow, random_wide)
from bench.planning.scenes import KINDS, known_axes, Scene
from gravity_comp_ros.data.samples import concatenate, FloatArray
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis, FOUND, Verdict
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import model_of, Switches
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning import Expectation, MotionPlan, plan, PlanOptions, Target
from gravity_comp_ros.planning.expected import outcome
from gravity_comp_ros.simulation import motions
import numpy as np

# Duration of a short plan, s.
SHORT_SECONDS = 7.0


def main() -> int:
    """Run the cases without results."""
    args = parser().parse_args()
    path = Path(args.results)
    lines = path.read_text().splitlines() if path.exists() else []
    done = {json.loads(line)['name'] for line in lines}
    deadline = time.monotonic() + args.minutes * 60
    for scene in scenes(args):
        if scene.name in done or time.monotonic() > deadline:
            continue
        with path.open('a') as file:
            file.write(json.dumps(run(scene, args.ways.split(','))) + '\n')
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    out = argparse.ArgumentParser(description='Planned motion against random and Fourier.')
    out.add_argument('results', help='file of JSON lines')
    out.add_argument('--arms', default='iiwa7,six_axis')
    out.add_argument('--effects', default=','.join(KINDS))
    out.add_argument('--seeds', default='0,1')
    out.add_argument('--ways', default=','.join(WAYS))
    out.add_argument('--poor', default=None, help='only these kinds of poor recordings')
    out.add_argument('--small', action='store_true', help='small effects, targets by name')
    out.add_argument('--described', action='store_true', help='with a robot description')
    out.add_argument('--minutes', type=float, default=1e9, help='start no case after this time')
    return out


def scenes(args: argparse.Namespace) -> list[Scene]:
    """Return all cases, seed by seed; with known axes base tilt is part of gravity."""
    poor_kinds = args.poor.split(',') if args.poor else None
    return [Scene(arm, effect, 0 if KINDS[effect].whole_arm else 1 + 2 * (seed % 2), poor, seed,
                  args.small, args.described)
            for seed in map(int, args.seeds.split(',')) for effect in args.effects.split(',')
            if not (args.described and KINDS[effect].whole_arm)
            for poor in KINDS[effect].poor if poor_kinds is None or poor in poor_kinds
            for arm in args.arms.split(',')]


def run(scene: Scene, ways: list[str]) -> dict[str, Any]:
    """Return the results before and after additional motion of each kind."""
    result: dict[str, Any] = {'name': scene.name, 'arm': scene.arm, 'effect': scene.effect,
                              'poor': scene.poor, 'tie': scene.kind.is_ambiguous, 'ways': {}}
    if not scene.is_visible:
        return {**result, 'invisible': True}
    try:
        case = Case(scene)
    except GravityCompError as problem:
        return {**result, 'error': str(problem)}
    result['before'] = judged(case.first, scene)
    result['left'] = outcome(scene.truth, case.first)
    if result['before'] == 'right':
        return result
    for way in ways:
        try:
            result['ways'][way] = case.after(way)
        except GravityCompError as problem:
            result['ways'][way] = {'error': str(problem)}
    return result


class Case:
    """A scene with its poor recording, model and first diagnosis."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.old = scene, scene.recorded()
        axes = known_axes(scene.arm_model) if scene.kind.known_axes or scene.described else None
        options = FitOptions('chain', geometry=axes)
        self.model: GravityModel = model_of(estimate(self.old, options), Switches())
        self.first = diagnose(self.old, self.model)
        self.targets = [scene.truth] if scene.kind.is_ambiguous or scene.small else None

    def after(self, way: str) -> dict[str, Any]:
        """Return the result after additional motion."""
        motion, plan_result = WAYS[way](self)
        both = concatenate([self.old, self.scene.later(motion)])
        diagnosis = diagnose(both, self.model)
        for expected in plan_result.get('expected', ()):
            target = Target(expected['effect'], expected['joint'])
            expected['outcome'] = outcome(target, diagnosis)
            truth = self.scene.truth
            if (target.effect, target.joint) == (truth.effect, truth.joint):
                assumed = next(iter(expected['assumed'].values()))
                expected['share'] = abs(self.scene.size / assumed)
        return {'verdict': judged(diagnosis, self.scene), 'duration': motion.t[-1], **plan_result,
                'left': outcome(self.scene.truth, diagnosis), 'sure': accepted(diagnosis)}

    def planned_wide(self) -> tuple[motions.Motion, dict[str, Any]]:
        """Return a motion planned within the middle half of the joints' range."""
        low, high = self.limits
        return self.planned(MORE_SECONDS, low=low, high=high, reach=math.inf)

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Return the middle half of the joints' range, extended to the recorded poses."""
        arm, q = self.scene.arm_model, self.old.q
        return (np.minimum(0.5 * arm.lower, q.min(axis=0)),
                np.maximum(0.5 * arm.upper, q.max(axis=0)))

    def planned(self, seconds: float, **limits: Any) -> tuple[motions.Motion, dict[str, Any]]:
        """Return the planned motion, its parts and its expected results."""
        started = time.process_time()
        planned: MotionPlan = plan(self.old, self.model, self.targets,
                                   PlanOptions(seconds, **limits), self.first)
        return played(planned.trajectory), {
            'plan_seconds': time.process_time() - started,
            'parts': [part.sentence for part in planned.parts],
            'expected': without_widths(planned.expectations)}

    def baseline(self, way: str) -> tuple[motions.Motion, dict[str, Any]]:
        """Return a motion that does not depend on the targets."""
        options, seed = PlanOptions(MORE_SECONDS), self.scene.seed
        if way == 'random':
            return random_slow(self.old, options, seed), {}
        if way == 'random_wide':
            return random_wide(options, *self.limits, seed), {}
        if way == 'fourier':
            return fourier(self.old, self.model, options, seed), {}
        return random_near(self.old, options, self.scene.joint, seed), {}


WAYS = {'planned': lambda case: case.planned(MORE_SECONDS),
        'planned_short': lambda case: case.planned(SHORT_SECONDS),
        'planned_wide': lambda case: case.planned_wide(),
        **{way: (lambda case, way=way: case.baseline(way))
           for way in ('random', 'random_near', 'fourier', 'random_wide')}}


def without_widths(expectations: tuple[Expectation, ...]) -> list[dict[str, Any]]:
    """Return the expected results without the widths of intervals."""
    return [{**each.to_json(), 'half_width': None} for each in expectations]


def accepted(diagnosis: Diagnosis) -> list[str]:
    """Return the established and likely effects by name and joint."""
    return [f'{f.effect}:{f.joint}' for f in diagnosis.findings
            if f.verdict in FOUND and f.effect not in ALWAYS_THERE]


def judged(diagnosis: Diagnosis, scene: Scene) -> str:
    """Return 'right', 'open' (effect not accepted) or 'wrong' (another effect accepted)."""
    truth = scene.truth
    name = scene.arm_model.joints[scene.joint]
    accepted_here = {str(f.effect) for f in diagnosis.findings if f.verdict in FOUND
                     and f.joint in (name, None) and f.effect is not None} - ALWAYS_THERE
    correct = {truth.effect, *scene.kind.equivalent}
    wrong = accepted_here - correct - set(scene.kind.allowed)
    if wrong:
        return 'wrong: ' + ', '.join(sorted(wrong))
    # An ambiguity between equivalent effects leaves nothing open.
    accepted_here |= {str(f.effect) for f in diagnosis.findings if f.joint == name
                      and f.verdict == Verdict.AMBIGUOUS and f.rivals
                      and {f.effect, *f.rivals} <= correct}
    return 'right' if correct & accepted_here else 'open'


if __name__ == '__main__':
    sys.exit(main())
