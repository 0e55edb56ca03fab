"""Tables of docs/paper.md in Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from bench.paper.friction import Check
from bench.paper.recordings import RecordingResult
from bench.paper.score import Row
from bench.paper.solvers import Solved
import numpy as np

PAPER_3 = '| Yu 2022, Table 3 | 246, 76, 171 | 0.28 to 0.44 a joint | 0.43 | 0.48 | 0.57 ' \
    '| – | – | – |'
PAPER_4 = '| Yu 2022, Tables 4 and 8 (their arm) | 55, 39, 45, 57 | 0.29 a joint | 0.87 ' \
    '| 1.75 | 1.99 | 1.35 | – | – | – | – |'
PAPER_8 = '| Yu 2022, Table 8: KRR with known D-H (their arm) | – | 4.09 a joint | 2.39 ' \
    '| 1.73 | 6.30 | 1.49 | – | – | – | – |'
PAPER_5 = {
    '1.8': (1.08, 1.16, 0.64, 0.71, 0.26, 0.41, 0.22, 0.37),
    '2': (1.23, 1.14, 0.72, 0.73, 0.32, 0.53, 0.22, 0.29),
    '4': (1.08, 1.32, 0.50, 0.84, 0.37, 0.41, 0.32, 0.41)}


def table(head: Sequence[str], rows: Sequence[str]) -> str:
    """Return a table in Markdown from a head and formatted rows."""
    return '\n'.join([f'| {" | ".join(head)} |', f'|{"---|" * len(head)}', *rows])


def row(*cells: object) -> str:
    """Return a row of a table."""
    return f'| {" | ".join(map(str, cells))} |'


def table_3(rows: Sequence[Row]) -> str:
    """Return Table 3: features, errors on Eq. (15) and over the whole range, times of J2 to J4."""
    joints = (1, 2, 3)
    body = [row(r.name, _features(r, joints), _seconds(r.seconds),
                *(_percent(r.nrmse_inside[k]) for k in joints), _torque(r.inside.max()),
                *_whole_range(r, joints))
            for r in rows]
    return table(['method', 'features J2, J3, J4', 'time s', 'J2 nRMSE %', 'J3', 'J4',
                  'worst joint N·m', 'other poses: nRMSE % J2, J3, J4', 'worst joint N·m'],
                 [*body, PAPER_3])


def table_4(rows: Sequence[Row]) -> str:
    """Return Tables 4 and 8 for J1 to J4, with errors relative to gravity alone."""
    joints = (0, 1, 2, 3)
    body = [row(r.name, _features(r, joints), _seconds(r.seconds),
                *(_percent(r.nrmse[k]) for k in joints), _torque(r.measured.max()),
                _torque(r.inside.max()), *_whole_range(r, (1, 2, 3)))
            for r in rows]
    return table(['method', 'features J1 to J4', 'time s', 'J1 nRMSE %', 'J2', 'J3',
                  'J4', 'RMSE, worst joint', 'gravity alone: worst joint',
                  'whole range: nRMSE % J2, J3, J4', 'whole range: worst joint'],
                 [*body, PAPER_4, PAPER_8])


def table_5(payload: str, rows: Sequence[Row]) -> str:
    """Return Table 5: RMSE of every joint with a payload, as measured and of gravity alone."""
    body = [row(r.name, r.n_samples or '–', _seconds(r.seconds),
                *(_torque(x) for x in r.measured), _torque(r.inside.max()),
                _torque(r.anywhere.max())) for r in rows]
    *theirs, seconds = PAPER_5[payload.split()[0]]
    body.append(row('Yu 2022, Table 5 (their arm)', 500, f'{seconds} a joint', *theirs, '–', '–'))
    return table(['method', 'samples', 'time s', *(f'J{n}' for n in range(1, 8)),
                  'gravity alone: worst', 'whole range: worst'], body)


def friction_table(checks: Sequence[Check]) -> str:
    """Return the RSE of Eq. (18) for each swept joint."""
    return table(['joint', 'RSE forward %', 'RSE reverse %'],
                 [row(f'J{c.joint + 1}', *(f'{100 * x:.3f}' for x in c.rse)) for c in checks])


def solver_table(solved: Sequence[Solved]) -> str:
    """Return objective, features and time of each solver."""
    return table(['solver', 'objective', 'features', 'time s'],
                 [row(s.name, f'{s.objective:.4f}', s.features, _seconds(s.seconds))
                  for s in solved])


def recordings_table(rows: Sequence[RecordingResult]) -> str:
    """Return the held-out errors of every formulation on every recording."""
    body = []
    for r in rows:
        share = r.rmse / np.maximum(r.constant, 1e-9)
        body.append(row(r.recording, r.method, f'{r.n_samples} / {r.n_held_out}',
                        ', '.join(f'{x:.2f}' for x in r.rmse),
                        f'{100 * float(np.median(share)):.0f}',
                        '–' if r.band is None else f'{100 * r.band:.0f}'))
    return table(['recording', 'method', 'samples / held out',
                  'held-out RMSE N·m, each joint', 'median joint: % of std', 'in 95 % band, %'],
                 body)


def _features(result: Row, joints: Sequence[int]) -> str:
    if result.features is None:
        return '–'
    return ', '.join(str(result.features[k]) for k in joints)


def _whole_range(result: Row, joints: Sequence[int]) -> tuple[str, str]:
    shares = ', '.join(_percent(result.nrmse_anywhere[k]) for k in joints)
    return shares, _torque(result.anywhere.max())


def _percent(share: float) -> str:
    return '–' if not np.isfinite(share) else f'{100 * share:.2g}' if share < 0.1 \
        else f'{100 * share:.0f}'


def _torque(value: float) -> str:
    return f'{value:.3f}' if value < 1.0 else f'{value:.2f}' if value < 10.0 else f'{value:.0f}'


def _seconds(value: float) -> str:
    return '–' if value == 0.0 else f'{value:.2f}'
