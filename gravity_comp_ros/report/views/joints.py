"""The errors joint by joint, against the previous model and against a constant."""

from __future__ import annotations

from gravity_comp_ros.diagnosis.wording import percent
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.headline import named_joint
from gravity_comp_ros.report.section import Section

_MOST_PLACES = 2


def section(contents: Contents) -> Section:
    """Return the table of errors, and where each joint fails."""
    found = contents.comparison.joints
    columns = ['joint', 'n', 'RMSE N·m', 'nRMSE', 'std N·m', 'largest N·m', 'in training N·m']
    if contents.previous:
        columns.append(f'{contents.previous_name} N·m')
    columns.append('a constant N·m')
    rows = []
    for name in contents.joints:
        joint = found[name]
        row = [name, joint.n, f'{joint.rmse:.4f}', percent(joint.nrmse), f'{joint.std:.4f}',
               f'{joint.max_abs:.3f}',
               f'{contents.model.noise[contents.model.joints.index(name)]:.4f}']
        if contents.previous:
            row.append(f'{contents.previous[name]:.4f}'
                       if name in contents.previous else '–')
        rows.append([*row, f'{joint.rmse_constant:.4f}'])
    lead = markup.paragraph(
        'Error is measured minus predicted torque. nRMSE is RMSE over the range of the measured '
        'torque (Yu 2022, Eq. 16); a joint that carries no gravity has a large one that means '
        'little. The last columns are what else there is: the error in training'
        + (f', of {contents.previous_name},' if contents.previous else '')
        + ' and of predicting the mean torque.', 'quiet')
    lead += markup.paragraph(f'The table is of {contents.judged}; plots show all samples.',
                             'quiet')
    table = markup.table(columns, rows, strong=contents.joints.index(named_joint(contents)))
    return Section('joints', 'Error, joint by joint', lead + table, after=_where(contents))


def _where(contents: Contents) -> str:
    lines = [f'{name} {place.words}' for name in contents.joints
             for place in contents.comparison.joints[name].where[:_MOST_PLACES]]
    outside = contents.comparison.share_outside
    if outside > 0.0:
        lines.insert(0, f'{100 * outside:.1f} % of these samples lie outside the poses that the '
                     f'model was trained on')
    if not lines:
        return markup.paragraph('No joint is worse in one place than elsewhere.', 'quiet')
    return '<h3>Where it is worse than elsewhere</h3>' + markup.bullets(lines)
