"""Table of the results of `bench.real_robots.run`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from bench.shared.markdown import table as table_of
import numpy as np

Result = Mapping[str, Any]
_HEAD = ('case', 'friction', 'hidden', 'named', 'error', 'before', 'oracle', 'static %',
         'largest %', 's', 'result')


def table(results: Sequence[Result]) -> str:
    """Return the cases and totals as Markdown."""
    return '\n'.join([table_of(_HEAD, map(_row, results)), '', *totals(results), ''])


def totals(results: Sequence[Result]) -> list[str]:
    """Return the counts and the worst cases, one sentence a line."""
    n = len(results)
    done = [r for r in results if 'error' in r]
    right, of_oracle, loose = (sum(not r[key] for r in results)
                               for key in ('why', 'why_oracle', 'why_loose'))
    out = [f'{right} of {n} right; with 1.25 x oracle on joints with LuGre friction: {of_oracle} '
           f'of {n}; within 2.5 x noise and 2 %: {loose} of {n}.']
    if not done:
        return out
    hidden = sum(len(r['hidden']) for r in done)
    missed, tied = (sum(len(r[key]) for r in done) for key in ('missed', 'tied'))
    out.append(f'Of {hidden} effects {hidden - missed - tied} named, {tied} tied, {missed} '
               f'missed; {sum(len(r["false"]) for r in done)} false findings in '
               f'{sum(bool(r["false"]) for r in done)} cases; '
               f'{sum(bool(r["refused"]) for r in done)} additions refused, {n - len(done)} '
               f'failed.')
    out.append(_figure(done, 'Error on the unseen run, worst joint', 'x noise',
                       lambda r: r['error'], 'error_joint'))
    out.append(_figure(done, 'Root mean square of the joints', 'x noise',
                       lambda r: r['pooled'], 'error_joint'))
    with_oracle = [r for r in done if r.get('oracle') and r['lugre']]
    if with_oracle:
        out.append(_figure(with_oracle, 'With LuGre friction, worst joints of both', 'x oracle',
                           lambda r: r['error'] / max(r['oracle']), 'error_joint'))
    out.append(_figure(done, 'Static torque, worst joint', '%',
                       lambda r: 100 * r['static'], 'static_joint'))
    intervals = [i for r in done for i in r['intervals']]
    covered = sum(i['covers'] for i in intervals)
    by_effect = []
    for effect in sorted({i['what'].split(':')[0] for i in intervals}):
        own = [i['covers'] for i in intervals if i['what'].startswith(effect)]
        by_effect.append(f'{effect} {sum(own)} of {len(own)}')
    out.append(f'{covered} of {len(intervals)} published 95 % intervals cover'
               + (f': {", ".join(by_effect)}.' if by_effect else '.'))
    times = [sum(r['seconds'].values()) for r in done]
    out.append(f'Processor time: {np.median(times):.1f} s in the median, {max(times):.1f} s at '
               f'most ({done[int(np.argmax(times))]["case"]}).')
    return out


def _figure(done: Sequence[Result], title: str, unit: str,
            value: Callable[[Result], float], joint: str) -> str:
    values = [value(r) for r in done]
    worst = done[int(np.argmax(values))]
    return (f'{title}: {np.median(values):.2f} {unit} in the median, {max(values):.2f} {unit} at '
            f'most ({worst["case"]}, joint {worst[joint]}).')


def _row(r: Result) -> list[str]:
    if 'error' not in r:
        return [str(r.get('case', 'not run')), '', '', '', '', '', '', '', '', '',
                '; '.join(r.get('why', ()))]
    named = len(r['hidden']) - len(r['missed'])
    result = '; '.join([*r['why'], *([f'refused: {r["refused"]}'] if r['refused'] else [])])
    return [r['case'], 'LuGre' if r['lugre'] else '', ' '.join(r['hidden']),
            f'{named}/{len(r["hidden"])}' + (f', {len(r["tied"])} tied' if r['tied'] else ''),
            f'{r["error"]:.2f}', f'{r["before"]:.2f}',
            '' if r.get('oracle') is None else f'{max(r["oracle"]):.2f}',
            f'{100 * r["static"]:.2f}', f'{100 * r["static_max"]:.2f}',
            f'{sum(r["seconds"].values()):.1f}', result or 'right']
