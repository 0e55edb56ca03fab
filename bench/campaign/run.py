"""
Hidden-effect campaign: diagnoses of arms with known unmodelled effects, unused for tuning.

Run from the root of the repository:

    python -m bench.campaign.run judged/ --judging --seeds 10 --jobs 2 \
        --arms iiwa7,six_axis,right_seven,right_six,any_six

The folder stores the diagnosis of every recording, so that a stopped campaign resumes. Results of
older code are recomputed, unless --keep is given. `campaign.md` in the same folder is the table.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
import sys
from time import monotonic
from typing import Any

from bench.campaign.judging import judging_case, KINDS
from bench.campaign.score import ALWAYS_THERE
from bench.campaign.table import markdown, Task
from bench.cases.cases import Case, recordings
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
        tasks = [Task(judging_case(arm, kind, seed), seed, args.rate)
                 for seed in range(args.first, args.seeds)
                 for arm in args.arms.split(',') for kind in args.judging.split(',')]
    except GravityCompError as error:
        print(error, file=sys.stderr)
        return 1
    missing = [task for task in tasks
               if not load(folder / task.file, None if args.keep else code)]
    print(f'{len(tasks)} recordings, {len(tasks) - len(missing)} done before', flush=True)
    run(partial(run_one, floor=not args.no_floor), missing, lambda task: folder / task.file, code,
        args.jobs, lambda result: f'{result["file"]} in {result["seconds"]:.1f} s')
    results = [(task, result) for task in tasks if (result := load(folder / task.file))]
    (folder / 'campaign.md').write_text(markdown(results))
    print(markdown(results))
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    out = argparse.ArgumentParser(description='Hidden-effect campaign of the diagnosis.')
    out.add_argument('folder', help='folder of results')
    out.add_argument('--arms', default='iiwa7,six_axis', help='(default: %(default)s)')
    out.add_argument('--judging', nargs='?', const=','.join(KINDS), default=','.join(KINDS),
                     metavar='KINDS', help='kinds of cases (default: %(const)s)')
    out.add_argument('--seeds', type=int, default=3, help='seeds 0 to N - 1 (default: 3)')
    out.add_argument('--first', type=int, default=0, help='first seed (default: 0)')
    out.add_argument('--rate', type=float, default=50.0, help='samples per second (default: 50)')
    out.add_argument('--jobs', type=int, default=1, help='processes (default: 1)')
    out.add_argument('--keep', action='store_true', help='keep results of older code')
    out.add_argument('--no-floor', action='store_true',
                     help='omit the fit with the true effects; takes a third of the time')
    return out


def run_one(task: Task, floor: bool) -> tuple[Task, dict[str, Any]]:
    """
    Return a recording's diagnosis, its time, and the error of a fit with the true effects.

    The candidates of that fit are the effects of the case, and dynamics.
    """
    samples = recordings(task.case, task.seed, task.rate)
    start = monotonic()
    result: dict[str, Any] = {'file': task.file, 'diagnosis': diagnose(samples).to_json()}
    result['seconds'] = monotonic() - start
    result['joints'] = list(samples.names)
    if floor and not task.case.untestable:
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
