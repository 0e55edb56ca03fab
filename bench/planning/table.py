"""
Tables of `bench.planning.run`: resolved cases by motion, and calibration of the stated chance.

    python -m bench.planning.table results.jsonl [more.jsonl ...]
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import json
from pathlib import Path
import sys
from typing import Any

from gravity_comp_ros.diagnosis.findings import FOUND
from gravity_comp_ros.planning.questions import OPEN
import numpy as np

# Columns of the table by motion; the last column is that of a user who follows the plan.
WAYS = {'planned': 'planned 20 s', 'planned_short': 'planned 7 s',
        'planned_wide': 'planned wide 20 s', 'random': 'random 20 s',
        'random_near': 'random, 3 joints', 'fourier': 'Fourier 20 s',
        'random_wide': 'random wide 20 s'}
_BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)


def main() -> int:
    """Print the tables of some files."""
    results = [json.loads(line) for name in sys.argv[1:]
               for line in Path(name).read_text().splitlines()]
    cases = [r for r in results if not r.get('invisible')]
    print(f'{len(results) - len(cases)} cases with an effect too small for any motion left out',
          resolved(cases), calibration(cases), sep='\n\n')
    return 0


def resolved(results: Sequence[dict[str, Any]]) -> str:
    """
    Return the counts of resolved cases by poor recording or ambiguous pair.

    The last row counts the cases whose diagnosis reports the effect as open.
    """
    groups = dict.fromkeys(_group(r) for r in results)
    ways = [way for way in WAYS if any(way in r['ways'] for r in results)]
    heads = ('recording', 'cases', 'right at first', 'open', *map(WAYS.get, ways), 'as advised')
    lines = ['| ' + ' | '.join(map(str, heads)) + ' |', '|' + '---|' * len(heads)]
    rows = [(name, [r for r in results if _group(r) == name]) for name in groups]
    reported = [r for r in results if r.get('left') in OPEN]
    for name, cases in [*rows, ('all', list(results)), ('all reported open', reported)]:
        open_cases = [r for r in cases if r['ways']]
        counts = [sum(_is_right(r, way) for r in open_cases) for way in ways]
        counts.append(sum(_is_right(r, advised(r)) for r in open_cases))
        at_first = sum(r.get('before') == 'right' for r in cases)
        lines.append(f'| {name} | {len(cases)} | {at_first} | {len(open_cases)} | '
                     + ' | '.join(map(str, counts)) + ' |')
    return '\n'.join(lines)


def advised(result: dict[str, Any]) -> str:
    """
    Return the motion of a user who follows the plan.

    It is the plan with wider limits if that near recorded poses states a chance below one half for
    the hidden effect, or does not include it.
    """
    expected = result['ways'].get('planned', {}).get('expected', ())
    # Only the hidden effect has the key `share`, its size relative to the assumed one.
    likely = any('share' in e and e['chance'] >= 0.5 for e in expected)
    return 'planned' if likely else 'planned_wide'


def _is_right(result: dict[str, Any], way: str) -> bool:
    return result['ways'].get(way, {}).get('verdict') == 'right'


def calibration(results: Sequence[dict[str, Any]]) -> str:
    """
    Return the frequency of found effects by their stated chance.

    Without an estimate the chance is the mean over the prior of the size; here the size is that
    of the simulation.
    """
    pairs = [(e['chance'], e['outcome'] in FOUND) for e in expectations(results) if 'share' in e]
    lines = ['| stated chance | motions | mean stated | found |', '|---|---|---|---|']
    for low, high in zip(_BINS, _BINS[1:]):
        here = [p for p in pairs if low <= p[0] < high or p[0] == high == 1.0]
        if here:
            stated, rate = np.mean(here, axis=0)
            lines.append(f'| {low:.0%} to {high:.0%} | {len(here)} | {stated:.0%} | {rate:.0%} |')
    return '\n'.join(lines)


def expectations(results: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the expected and actual result of every target of every motion."""
    return [{**e, 'way': way, 'name': r['name'], 'verdict': outcome['verdict']} for r in results
            for way, outcome in r['ways'].items() for e in outcome.get('expected', ())]


def _group(result: dict[str, Any]) -> str:
    return str(result['effect'] if result['tie'] else result['poor'])


if __name__ == '__main__':
    sys.exit(main())
