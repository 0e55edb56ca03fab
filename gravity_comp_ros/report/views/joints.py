"""Errors of each joint, compared with the previous model and a constant torque."""

from __future__ import annotations

from gravity_comp_ros.display import percent
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.headline import named_joint
from gravity_comp_ros.report.section import Section

_MAX_REGIONS = 2


def section(contents: Contents) -> Section:
    """Return the table of errors and the regions of large error."""
    errors = contents.comparison.joints
    columns = ['joint', 'n', 'RMSE N·m', 'nRMSE', 'std N·m', 'largest N·m', 'in training N·m']
    if contents.previous:
        columns.append(f'{contents.previous_name} N·m')
    columns.append('constant torque N·m')
    rows = []
    for name in contents.joints:
        joint = errors[name]
        row = [name, joint.n, contents.error(name), percent(joint.nrmse), f'{joint.std:.4f}',
               f'{joint.max_abs:.3f}',
               f'{contents.model.noise[contents.model.joints.index(name)]:.4f}']
        if contents.previous:
            row.append(f'{contents.previous[name]:.4f}'
                       if name in contents.previous else '–')
        rows.append([*row, f'{joint.rmse_constant:.4f}'])
    lead = markup.paragraph(
        'The error is measured minus predicted torque. nRMSE is RMSE over the range of the '
        'measured torque (Yu 2022, Eq. 16); it is meaningless for joints without gravity load. '
        'The last columns are for comparison: the training error'
        + (f', the error of {contents.previous_name},' if contents.previous else '')
        + ' and the error of a constant torque.', 'quiet')
    lead += markup.paragraph(f'Errors: {contents.compared}. Plots show all samples.',
                             'quiet')
    table = markup.table(columns, rows, strong=contents.joints.index(named_joint(contents)))
    return Section('joints', 'Errors by joint', lead + table, after=_regions(contents))


def _regions(contents: Contents) -> str:
    lines = [f'{name} {region.words}' for name in contents.joints
             for region in contents.comparison.joints[name].where[:_MAX_REGIONS]]
    outside = contents.comparison.share_outside
    if outside > 0.0:
        lines.insert(0, f'{100 * outside:.1f} % of these samples are outside the trained poses')
    if not lines:
        return markup.paragraph('No joint has a region of larger error.', 'quiet')
    return '<h3>Regions of large error</h3>' + markup.bullets(lines)
