"""
Write the tables of docs/performance.md from the results of the benchmarks.

    python3 -m bench.solver.table [--solver FILE] [--scale FILE]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
import re

from bench.shared import stored

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs' / 'performance.md'


def solvers(parts: list[list[dict]]) -> str:
    """Return the table of one data set."""
    rows = {}
    for run in (run for part in parts for run in part if 'solver' in run):
        name, missed = run['solver'], run.get('missed')
        if missed:
            cells = ('one', f'not reached after {seconds(missed["seconds"])}',
                     f'over {number(missed["ratio"])} ×', missed['iterations'],
                     f'{missed["gap"]:.0e}', '')
        else:
            cells = (len(run['joints']), seconds(run['seconds']),
                     f'{number(run["ratio"])} ×', run['iterations'], f'{run["gap"]:.0e}',
                     megabytes(run['megabytes']))
        rows.setdefault(name, (name, *cells))
    built = parts[0][0]['build']
    matrix, halves = (f'{seconds(built[part]["seconds"])} and {built[part]["megabytes"]:.0f} MB'
                      for part in ('matrix', 'halves'))
    return stored.table(
        ('solver', 'joints', 'time', 'relative to ours', 'iterations', 'gap', 'memory'),
        rows.values()) + (
            f'\n\nConstruction comes before: the matrix of the others takes {matrix} a joint, '
            f'our Kronecker factors {halves}.')


def growth(rows: list[dict]) -> str:
    return stored.table(
        ('joints', 'features', 'L1 problem', 'whole fit of the joint, memory', 'dense matrix'),
        [(row['joints'], row['features'], seconds(row['seconds']),
          f'{seconds(row["fit_seconds"])}, {row["megabytes"]:.0f} MB',
          f'{8e-6 * 1000 * row["features"]:.0f} MB') for row in rows[::2]])


def bags(results: dict) -> str:
    read, minute = results['read'], results['minute']
    return ('| | |\n|---|---|\n'
            f'| messages | {read["messages"]} |\n'
            f'| decoded, a second of one core | {read["decode_per_s"]:.0f} |\n'
            f'| rosbags, each message, a second of one core | {minute["rosbags_per_s"]:.0f} |\n'
            f'| ours on the same minute | {minute["decode_per_s"]:.0f}, '
            f'{minute["ratio"]:.0f} × |')


def seconds(value: float) -> str:
    return f'{1e3 * value:.0f} ms' if value < 1 else f'{value:.1f} s'


def megabytes(value: float | None) -> str:
    return '' if value is None else f'{value:.0f} MB'


def number(value: float) -> str:
    return f'{value:.1f}' if value < 20 else f'{value:.0f}'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--solver', type=Path, default=ROOT / 'bench/solver/results.json')
    parser.add_argument('--scale', type=Path, default=ROOT / 'bench/scale/results.json')
    args = parser.parse_args()
    tables = {}
    if args.solver.exists():
        results = json.loads(args.solver.read_text())
        if 'eq17' in results:
            tables['eq17'] = solvers([results['eq17'], results.get('eq17_slow', [])])
        if 'growth' in results:
            tables['growth'] = growth(results['growth'])
    if args.scale.exists():
        tables['bags'] = bags(json.loads(args.scale.read_text()))
    text = PAGE.read_text()
    for name, table in tables.items():
        text = re.sub(f'(<!-- {name} -->\n).*?(<!-- end -->)',
                      lambda m, t=table: f'{m[1]}{t}\n{m[2]}', text, flags=re.S)
    PAGE.write_text(text)


if __name__ == '__main__':
    main()
