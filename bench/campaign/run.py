"""
Hidden-effect campaign: diagnoses of arms with known unmodelled effects, unused for tuning.

Run from the root of the repository:

    python -m bench.campaign.run judged/ --seeds 0-9 --jobs 2 \
        --arms iiwa7,six_axis,right_seven,right_six,any_six
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
import sys
from time import monotonic
from typing import Any

from bench.campaign.judging import judging_case, KINDS
from bench.campaign.score import score, table
from bench.cases.cases import Case, recordings
from bench.shared.findings import ALWAYS_THERE
from bench.shared.runner import names, Result, run, seeds
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.verdict import DiagnosisOptions


def options(parser: ArgumentParser) -> None:
    parser.add_argument('--arms', type=names, default='iiwa7,six_axis',
                        help='(default: %(default)s)')
    parser.add_argument('--kinds', type=names, default=','.join(KINDS),
                        help='kinds of cases (default: %(default)s)')
    parser.add_argument('--seeds', type=seeds, default='0-2', help='(default: %(default)s)')
    parser.add_argument('--rate', type=float, default=50.0, help='Hz (default: %(default)s)')
    parser.add_argument('--no-floor', action='store_true',
                        help='omit the fit with the true effects; takes a third of the time')


def cases(args: Namespace) -> dict[str, tuple[Any, ...]]:
    return {f'{arm}.{kind}.{seed}.{args.rate:g}': (arm, kind, seed, args.rate, not args.no_floor)
            for seed in args.seeds for arm in args.arms for kind in args.kinds}


def diagnosed(arm: str, kind: str, seed: int, rate: float, floor: bool) -> Result:
    """
    Return a recording's diagnosis, its time, and the error of a fit with the true effects.

    The candidates of that fit are the effects of the case, and dynamics.
    """
    case = judging_case(arm, kind, seed)
    samples = recordings(case, seed, rate)
    start = monotonic()
    diagnosis = diagnose(samples).to_json()
    result: Result = {'arm': arm, 'kind': kind, 'seed': seed, 'joints': list(samples.names),
                      'seconds': monotonic() - start, 'diagnosis': diagnosis,
                      **score(case, diagnosis, samples.names)}
    if floor and not case.untestable:
        oracle = diagnose(samples, options=DiagnosisOptions(effects=true_effects(case))).to_json()
        result['floor'] = {name: report['rmse_after']
                           for name, report in oracle['joints'].items()}
    return result


def true_effects(case: Case) -> tuple[str, ...]:
    """Return the names of all effects in a case."""
    return tuple(sorted({*ALWAYS_THERE, *(name for name, _ in case.expected | case.allowed)}))


if __name__ == '__main__':
    sys.exit(run(__doc__, options, cases, diagnosed,
                 lambda result: '; '.join(result['wrong']) or 'right', table))
