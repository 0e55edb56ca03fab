"""
Hidden-effect campaign: diagnoses of arms with known unmodelled effects.

Run from the root of the repository:

    python -m bench.campaign.run results/ --seeds 10 --jobs 2
    python -m bench.campaign.run results/ --arms iiwa7 --cases coulomb_large,detent --seeds 3
    python -m bench.campaign.run judged/ --judging --seeds 10 --jobs 2 \
        --arms iiwa7,six_axis,right_seven,right_six,any_six

The folder stores the diagnosis of every recording, so that a stopped campaign resumes. Results of
older code are recomputed, unless --keep is given. Summaries are `campaign.json` and `campaign.md`
in the same folder.
"""

from __future__ import annotations

import argparse
from functools import partial
import json
from pathlib import Path
import resource
import sys
from time import monotonic
from typing import Any

from bench.campaign.judging import judging_case, KINDS
from bench.campaign.score import ALWAYS_THERE
from bench.campaign.table import markdown, summary, Task
from bench.cases.case_list import case, cases, ROLES
from bench.cases.cases import Case, recordings
from bench.cases.drawn import drawn_case
from bench.shared.stored import fingerprint, load, run
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.verdict import DiagnosisOptions
from gravity_comp_ros.errors import GravityCompError


def main() -> int:
    """Diagnose recordings without a result, score all requested ones, and write the table."""
    args = parser().parse_args()
    folder = Path(args.folder)
    folder.mkdir(parents=True, exist_ok=True)
    code = fingerprint()
    try:
        tasks = [Task(entry, seed, args.rate) for seed in range(args.first, args.seeds)
                 for entry in chosen(args, seed)]
    except GravityCompError as error:
        print(error, file=sys.stderr)
        return 1
    missing = [task for task in tasks
               if not load(folder / task.file, None if args.keep else code)]
    print(f'{len(tasks)} recordings, {len(tasks) - len(missing)} done before', flush=True)
    run(partial(run_one, floor=not args.no_floor), missing, lambda task: folder / task.file, code,
        args.jobs, lambda result: f'{result["file"]} in {result["seconds"]:.1f} s')
    results = [(task, result) for task in tasks if (result := load(folder / task.file))]
    (folder / 'campaign.json').write_text(json.dumps(summary(results), indent=1))
    (folder / 'campaign.md').write_text(markdown(results))
    print(markdown(results))
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    out = argparse.ArgumentParser(description='Hidden-effect campaign of the diagnosis.')
    out.add_argument('folder', help='folder of results')
    out.add_argument('--arms', default=','.join(ROLES), help=f'(default: {",".join(ROLES)})')
    out.add_argument('--cases', help='names, separated by commas (default: all)')
    out.add_argument('--drawn', type=int, default=0, metavar='N',
                     help='instead of the named cases, N with random effects, joints and sizes')
    out.add_argument('--judging', action='store_true',
                     help='instead of the named cases, test cases unused for tuning: '
                     + ', '.join(KINDS))
    out.add_argument('--seeds', type=int, default=3, help='seeds 0 to N - 1 (default: 3)')
    out.add_argument('--first', type=int, default=0, help='first seed (default: 0)')
    out.add_argument('--rate', type=float, default=50.0, help='samples per second (default: 50)')
    out.add_argument('--jobs', type=int, default=1, help='processes (default: 1)')
    out.add_argument('--keep', action='store_true', help='keep results of older code')
    out.add_argument('--no-floor', action='store_true',
                     help='omit the fit with the true effects; takes a third of the time')
    return out


def chosen(args: argparse.Namespace, seed: int = 0) -> list[Case]:
    """Return the requested cases, on all arms."""
    arms = args.arms.split(',')
    if args.judging:
        chosen_kinds = args.cases.split(',') if args.cases else KINDS
        return [judging_case(arm, kind, seed) for arm in arms for kind in chosen_kinds]
    if args.drawn:
        return [drawn_case(arm, number) for arm in arms for number in range(args.drawn)]
    if args.cases:
        return [case(arm, name) for arm in arms for name in args.cases.split(',')]
    return [entry for arm in arms for entry in cases(arm)]


def run_one(task: Task, floor: bool) -> tuple[Task, dict[str, Any]]:
    """
    Return a recording's diagnosis, its time, and the error of a fit with the true effects.

    The candidates of that fit are the effects of the case, and dynamics.
    """
    samples = recordings(task.case, task.seed, task.rate)
    start = monotonic()
    result: dict[str, Any] = {'file': task.file, 'diagnosis': diagnose(samples).to_json()}
    result['seconds'] = monotonic() - start
    result['peak_mb'] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    result['joints'] = list(samples.names)
    if floor and task.case.verdict == 'found':
        oracle = diagnose(samples, options=DiagnosisOptions(
            effects=true_effects(task.case))).to_json()
        result['floor'] = {name: report['rmse_after']
                           for name, report in oracle['joints'].items()}
    return task, result


def true_effects(case: Case) -> tuple[str, ...]:
    """Return the names of all effects in a case."""
    names = {name for name, _ in (*case.expected, *case.allowed)}
    return tuple(sorted({*ALWAYS_THERE, *names}))


if __name__ == '__main__':
    sys.exit(main())
