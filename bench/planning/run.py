"""
Does a planned motion settle what a poor recording leaves open, sooner than other motion does.

Run from the root of the repository; what is in the results already is not run again:

    python -m bench.planning.run results.jsonl --arms iiwa7,six_axis --seeds 0,1
    python -m bench.planning.table results.jsonl

Each case is an arm with one hidden effect and a poor recording of 60 s. Those whose diagnosis is
not right go on with a planned motion of 20 s or of 7 s near recorded poses, with one of 20 s in
the middle half of the joints' range, and with 20 s of slow random motion of all joints, of slow
random motion of three joints near recorded poses, of slow random motion in that middle half, and
of a Fourier series that excites all parameters alike. A case is settled rightly if the diagnosis
of both recordings finds the effect on its joint, established or likely, and nothing else there.
The plan is for all that the diagnosis leaves open; in a tie it is for the hidden effect, as
somebody asks who suspects it.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
import sys
import time
from typing import Any

from bench.planning.rivals import (
    fourier, MORE_SECONDS, played, random_near, random_slow, random_wide)
from bench.planning.scenes import KINDS, known_axes, Scene
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate, FloatArray
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis, FOUND
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning import Expectation, Plan, plan, PlanOptions, Target
from gravity_comp_ros.planning.outcome import outcome
from gravity_comp_ros.simulation import motions
import numpy as np

SHORT_SECONDS = 7.0
_ALWAYS_THERE = ('inertia', 'coriolis', 'rigid_body_dynamics')


def main() -> int:
    """Run what is missing."""
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
    out.add_argument('--small', action='store_true', help='small effects, asked for by name')
    out.add_argument('--described', action='store_true', help='with a robot description')
    out.add_argument('--minutes', type=float, default=1e9, help='begin no case after this time')
    return out


def scenes(args: argparse.Namespace) -> list[Scene]:
    """Return all cases, seed by seed; on known axes gravity has the tilt of the base itself."""
    wanted = args.poor.split(',') if args.poor else None
    return [Scene(arm, effect, 0 if KINDS[effect].whole_arm else 1 + 2 * (seed % 2), poor, seed,
                  args.small, args.described)
            for seed in map(int, args.seeds.split(',')) for effect in args.effects.split(',')
            if not (args.described and KINDS[effect].whole_arm)
            for poor in KINDS[effect].poor if wanted is None or poor in wanted
            for arm in args.arms.split(',')]


def run(scene: Scene, ways: list[str]) -> dict[str, Any]:
    """Return how it was judged before, and after more motion of each kind."""
    found: dict[str, Any] = {'name': scene.name, 'arm': scene.arm, 'effect': scene.effect,
                             'poor': scene.poor, 'tie': scene.kind.is_tie, 'ways': {}}
    try:
        case = Case(scene)
    except GravityCompError as problem:
        return {**found, 'error': str(problem)}
    found['before'] = judged(case.first, scene)
    found['left'] = outcome(scene.truth, case.first)
    if found['before'] == 'right':
        return found
    for way in ways:
        try:
            found['ways'][way] = case.after(way)
        except GravityCompError as problem:
            found['ways'][way] = {'error': str(problem)}
    return found


class Case:
    """A scene with its poor recording, model and first diagnosis."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.old = scene, scene.recorded()
        axes = known_axes(scene.made) if scene.kind.known_axes or scene.described else None
        slow = slow_samples(self.old).samples
        self.model: GravityModel = fit(slow, FitOptions('chain', geometry=axes)).model
        self.first = diagnose(self.old, self.model)
        self.targets = [scene.truth] if scene.kind.is_tie or scene.small else None

    def after(self, way: str) -> dict[str, Any]:
        """Return how the case is judged after more motion."""
        motion, said = WAYS[way](self)
        both = concatenate([self.old, self.scene.later(motion)])
        diagnosis = diagnose(both, self.model)
        for expected in said.get('expected', ()):
            target = Target(expected['effect'], expected['joint'])
            expected['outcome'] = outcome(target, diagnosis)
            truth = self.scene.truth
            if (target.effect, target.joint) == (truth.effect, truth.joint):
                assumed = next(iter(expected['assumed'].values()))
                expected['share'] = abs(self.scene.size / assumed)
        return {'verdict': judged(diagnosis, self.scene), 'duration': motion.t[-1], **said,
                'left': outcome(self.scene.truth, diagnosis), 'sure': sure(diagnosis)}

    def planned_wide(self) -> tuple[motions.Motion, dict[str, Any]]:
        """Return a motion planned within the limits of the joints, not the recorded poses."""
        low, high = self.limits
        return self.planned(MORE_SECONDS, low=low, high=high, reach=math.inf)

    @property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Return the middle half of the joints' range, with room for the recorded poses."""
        arm, q = self.scene.made, self.old.q
        return (np.minimum(0.5 * arm.lower, q.min(axis=0)),
                np.maximum(0.5 * arm.upper, q.max(axis=0)))

    def planned(self, seconds: float, **limits: Any) -> tuple[motions.Motion, dict[str, Any]]:
        """Return the planned motion, and what was expected of it."""
        started = time.process_time()
        found: Plan = plan(self.old, self.model, self.targets, PlanOptions(seconds, **limits),
                           self.first)
        return played(found.trajectory), {
            'plan_seconds': time.process_time() - started,
            'parts': [part.sentence for part in found.parts],
            'expected': told(found.expectations)}

    def rival(self, way: str) -> tuple[motions.Motion, dict[str, Any]]:
        """Return a motion that knows nothing of what is open."""
        options, seed = PlanOptions(MORE_SECONDS), self.scene.seed
        if way == 'random':
            return random_slow(self.old, options, seed), {}
        if way == 'random_wide':
            return random_wide(self.old, options, *self.limits, seed), {}
        if way == 'fourier':
            return fourier(self.old, self.model, options, seed), {}
        return random_near(self.old, options, self.scene.joint, seed), {}


WAYS = {'planned': lambda case: case.planned(MORE_SECONDS),
        'planned_short': lambda case: case.planned(SHORT_SECONDS),
        'planned_wide': lambda case: case.planned_wide(),
        **{way: (lambda case, way=way: case.rival(way))
           for way in ('random', 'random_near', 'fourier', 'random_wide')}}


def told(expectations: tuple[Expectation, ...]) -> list[dict[str, Any]]:
    """Return what was expected, without the widths of intervals."""
    return [{**each.to_json(), 'half_width': None} for each in expectations]


def sure(diagnosis: Diagnosis) -> list[str]:
    """Return the established and likely effects by name and joint."""
    return [f'{f.effect}:{f.joint}' for f in diagnosis.findings
            if f.verdict in FOUND and f.effect not in _ALWAYS_THERE]


def judged(diagnosis: Diagnosis, scene: Scene) -> str:
    """Return 'right', 'open' (the effect is not sure) or 'wrong' (another one is sure)."""
    truth = scene.truth
    name = scene.made.joints[scene.joint]
    here = {str(f.effect) for f in diagnosis.findings if f.verdict in FOUND
            and f.joint in (name, None) and f.effect is not None} - set(_ALWAYS_THERE)
    answers = {truth.effect, *scene.kind.answers}
    wrong = here - answers - set(scene.kind.beside)
    if wrong:
        return 'wrong: ' + ', '.join(sorted(wrong))
    return 'right' if answers & here else 'open'


if __name__ == '__main__':
    sys.exit(main())
