"""Tables of docs/paper.md in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bench.paper.methods import Row
from bench.paper.scenes import FloatArray
from bench.shared.runner import table_of
import numpy as np

PAPER_3 = ('Yu 2022, Table 3', '246, 76, 171', '0.28 to 0.44 a joint', '0.43, 0.48, 0.57',
           *3 * ['–'])
PAPER_4 = ('Yu 2022, Tables 4 and 8 (their arm)', '55, 39, 45, 57', '0.29 a joint',
           '0.87, 1.75, 1.99, 1.35', *3 * ['–'])
PAPER_8 = ('Yu 2022, Table 8: KRR with known D-H (their arm)', '–', '4.09 a joint',
           '2.39, 1.73, 6.30, 1.49', *3 * ['–'])
# RMSE of the worst joint in N·m, for each payload.
PAPER_5 = ('Yu 2022, Table 5 (their arm)', 500, 1.16, 1.23, 1.32)


def table_3(rows: Sequence[Row]) -> str:
    """Return Table 3: features, times, errors on Eq. (15) and on other poses, of J2 to J4."""
    joints = (1, 2, 3)
    body = [(r.name, _features(r, joints), _seconds(r.seconds),
             _percents(r.nrmse_inside, joints), _torque(r.inside.max()),
             _percents(r.nrmse_anywhere, joints), _torque(r.anywhere.max())) for r in rows]
    return table_of(['method', 'features', 'time s', 'nRMSE %', 'worst joint N·m',
                     'other poses: nRMSE %', 'worst joint N·m'], [*body, PAPER_3])


def table_4(rows: Sequence[Row]) -> str:
    """Return Tables 4 and 8 for J1 to J4, with errors relative to gravity alone."""
    joints = (0, 1, 2, 3)
    body = [(r.name, _features(r, joints), _seconds(r.seconds), _percents(r.nrmse, joints),
             *(_torque(error.max()) for error in (r.measured, r.inside, r.anywhere)))
            for r in rows]
    return table_of(['method', 'features', 'time s', 'nRMSE %', 'worst joint N·m',
                     'gravity alone', 'whole range'], [*body, PAPER_4, PAPER_8])


def table_5(payloads: Mapping[str, Sequence[Row]]) -> str:
    """Return the errors of the worst joint with each payload: measured, gravity, whole range."""
    body = []
    for rows in zip(*payloads.values()):
        errors = [' / '.join(_torque(error.max()) for error in (r.measured, r.inside, r.anywhere))
                  for r in rows]
        body.append((rows[0].name, rows[0].n_samples or '–', *errors))
    return table_of(['method', 'samples', *payloads], [*body, PAPER_5])


def small_motion(rows: Sequence[Row]) -> str:
    """Return the errors of gravity alone, later on the same motion and over the whole range."""
    return table_of(['method', 'same motion later', 'whole range'],
                    [(r.name, _torque(r.inside.max()), _torque(r.anywhere.max())) for r in rows])


def friction(rse: Mapping[str, Sequence[float]]) -> str:
    """Return the RSE of Eq. (18) of each joint, forward and reverse."""
    return table_of(['joint', 'RSE forward %', 'RSE reverse %'],
                    [(name, *(f'{100 * x:.3f}' for x in both)) for name, both in rse.items()])


def _features(result: Row, joints: Sequence[int]) -> str:
    if result.features is None:
        return '–'
    return ', '.join(str(result.features[k]) for k in joints)


def _percents(shares: FloatArray, joints: Sequence[int]) -> str:
    return ', '.join(_percent(shares[k]) for k in joints)


def _percent(share: float) -> str:
    return '–' if not np.isfinite(share) else f'{100 * share:.2g}' if share < 0.1 \
        else f'{100 * share:.0f}'


def _torque(value: float) -> str:
    return f'{value:.3f}' if value < 1.0 else f'{value:.2f}' if value < 10.0 else f'{value:.0f}'


def _seconds(value: float) -> str:
    return '–' if value == 0.0 else f'{value:.2f}'
