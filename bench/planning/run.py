"""
Does a planned motion settle what a poor recording leaves open, sooner than other motion does.

Run from the root of the repository:

    python -m bench.planning.run results.json --seeds 2 --arms iiwa7,six_axis

Each case is an arm with one hidden effect and a poor recording of 60 s. Those that the diagnosis
does not settle go on with 20 s more: planned, slow random motion of all joints, and a Fourier
series that excites all parameters alike. A case is settled rightly if the diagnosis of both
recordings finds the effect on its joint, established or likely, and nothing else on that joint.
The diagnosis knows the effects of `KNOWN` only, which takes a tenth of the time.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
import json
from pathlib import Path
import sys
import time
from typing import Any

from bench.planning.scenes import (
    ARMS, EFFECTS, fourier, MORE_SECONDS, played, POOR, random_slow, Scene)
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.diagnose import diagnose, DiagnosisOptions
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning import plan, PlanOptions

KNOWN = ('coulomb_friction', 'viscous_friction', 'load_dependent_friction', 'torque_offset',
         'joint_spring', 'inertia')
WAYS = ('planned', 'random', 'fourier')
_SURE = ('established', 'likely')
_ALWAYS_THERE = ('inertia',)


def main() -> int:
    """Run what is missing, and print the table."""
    args = parser().parse_args()
    path = Path(args.results)
    done: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    deadline = time.monotonic() + args.minutes * 60
    for scene in scenes(args):
        if scene.name in done or time.monotonic() > deadline:
            continue
        done[scene.name] = run(scene)
        path.write_text(json.dumps(done, indent=1))
        print(scene.name, {k: v for k, v in done[scene.name].items() if k != 'parts'}, flush=True)
    print(table(done))
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    out = argparse.ArgumentParser(description='Planned motion against random and Fourier.')
    out.add_argument('results', help='JSON file; what is in it is not run again')
    out.add_argument('--arms', default=','.join(ARMS))
    out.add_argument('--seeds', type=int, default=2)
    out.add_argument('--minutes', type=float, default=1e9, help='begin no case after this time')
    return out


def scenes(args: argparse.Namespace) -> list[Scene]:
    """Return all cases, seed by seed."""
    return [Scene(arm, effect, joint, poor, seed) for seed in range(args.seeds)
            for poor in POOR for arm in args.arms.split(',') for effect in EFFECTS
            for joint in (1 + 2 * (seed % 2),)]


def run(scene: Scene) -> dict[str, Any]:
    """Return whether the effect was settled before, and after 20 s more of each kind."""
    try:
        return _run(scene)
    except GravityCompError as problem:
        return {'error': str(problem)}


def _run(scene: Scene) -> dict[str, Any]:
    old = scene.recorded(scene.poor_motion(), 0)
    slow = slow_samples(old).samples
    model = fit(slow, FitOptions('chain')).model
    first = diagnose(old, model, DiagnosisOptions(effects=KNOWN))
    result: dict[str, Any] = {'before': judged(first, scene, old)}
    if result['before'] == 'right':
        return result
    options = PlanOptions(MORE_SECONDS)
    started = time.process_time()
    try:
        found = plan(old, model, None, options, first)
        result['plan_seconds'] = time.process_time() - started
        result['parts'] = [part.sentence for part in found.parts]
        result['chance'] = {e.target.name: e.chance for e in found.expectations}
        more = {'planned': played(found.trajectory)}
    except GravityCompError as problem:
        result['planned'], more = f'no plan: {problem}', {}
    more['random'] = random_slow(old, options, scene.seed)
    more['fourier'] = fourier(old, model, options, scene.seed)
    for way, motion in more.items():
        both = concatenate([old, scene.recorded(motion, 1)])
        result[way] = judged(again(both, model), scene, both)
    return result


def again(samples: JointSamples, model: GravityModel) -> Diagnosis:
    """Return the diagnosis of both recordings beside a model of both."""
    fresh = fit(slow_samples(samples).samples, FitOptions('chain')).model
    return diagnose(samples, fresh, DiagnosisOptions(effects=KNOWN))


def judged(diagnosis: Diagnosis, scene: Scene, samples: JointSamples) -> str:
    """Return 'right', 'open' (the effect is not sure) or 'wrong' (another one is sure)."""
    joint = samples.names[scene.joint]
    sure = {f.effect for f in diagnosis.findings
            if f.joint == joint and f.verdict in _SURE} - set(_ALWAYS_THERE)
    if sure - {scene.effect}:
        return 'wrong: ' + ', '.join(sorted(str(effect) for effect in sure - {scene.effect}))
    return 'right' if scene.effect in sure else 'open'


def table(done: dict[str, Any]) -> str:
    """Return the counts by what the poor recording lacks."""
    rows: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for name, result in done.items():
        rows[name.split('-')[3]].append(result)
    lines = ['| recording | cases | right at once | left | planned | random | Fourier |',
             '|---|---|---|---|---|---|---|']
    for poor, results in rows.items():
        left = [r for r in results if 'error' not in r and r['before'] != 'right']
        counts = [sum(r.get(way) == 'right' for r in left) for way in WAYS]
        at_once = sum(r.get('before') == 'right' for r in results)
        lines.append(f'| {poor} | {len(results)} | {at_once} | {len(left)} | '
                     + ' | '.join(map(str, counts)) + ' |')
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
