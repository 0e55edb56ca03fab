"""Headline, error of each joint, plot of the main finding, next command, and regions."""

from __future__ import annotations

from bokeh.plotting import figure
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.display import percent
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, REPORT, Table
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.views import effects, residuals
import numpy as np


def headline(contents: Contents) -> str:
    """Return the largest error, and the missing effects or the joints with unusual errors."""
    if contents.diagnosis is not None:
        return f'{_largest(contents)}. {wording.verdict(contents.diagnosis)}'
    errors = {name: contents.comparison.joints[name] for name in contents.joints}
    useless = [name for name, joint in errors.items() if joint.rmse > max(
        joint.torque_std, REPORT.larger * _noise(contents, name))]
    if 2 * len(useless) > len(errors):
        return (f'The model is worse than a constant on {", ".join(useless)}: the arm, the signs '
                f'or units of the effort, or the payload differ from those of the fit.')
    worse = [name for name, joint in errors.items()
             if joint.rmse > REPORT.worse * _noise(contents, name)]
    if worse:
        return (f'{_largest(contents)}; more than twice the training error: '
                f'{", ".join(worse)}.')
    return f'{_largest(contents)}; no error exceeds twice the training error.'


def main_finding(contents: Contents) -> Finding | None:
    """Return the first finding of the headline, None if there is none."""
    diagnosis = contents.diagnosis
    return next(iter(diagnosis.found or diagnosis.findings), None) if diagnosis else None


def _largest(contents: Contents) -> str:
    """Return a sentence on the joint with the largest error, without a full stop."""
    worst = contents.worst
    error = contents.comparison.joints[worst]
    sentence = (f'The error is largest on {worst}: {contents.error(worst)} N·m RMSE, '
                f'{percent(error.nrmse)} of the range of its torque')
    others = [contents.comparison.joints[name].rmse for name in contents.joints if name != worst]
    median = float(np.median(others)) if others else 0.0
    if median > 0.0 and error.rmse > REPORT.larger * median:
        sentence += f' and {error.rmse / median:.2g} times that of the other joints'
    return sentence


def _noise(contents: Contents, name: str) -> float:
    return float(contents.model.noise[contents.model.joints.index(name)])


def _errors(contents: Contents) -> str:
    """Return the table of errors, with a bar for the RMSE of each joint."""
    errors = contents.comparison.table(
        contents.joints, dict(zip(contents.model.joints, contents.model.noise.tolist())),
        contents.previous, contents.previous_name)
    rmse = [contents.comparison.joints[name].rmse for name in contents.joints]
    return errors.html(contents.joints.index(contents.worst),
                       [x / (max(rmse) or 1.0) for x in rmse])


def _explanation(contents: Contents) -> str:
    return markup.paragraph(
        f'Errors: {contents.compared}. Plots show all samples. The error is measured minus '
        'predicted torque. nRMSE is RMSE over the range of the measured torque (Yu 2022, Eq. 16); '
        'it is meaningless for joints without gravity load. For comparison: the training error'
        + (f', the error of {contents.previous_name},' if contents.previous else '')
        + ' and the error of a constant torque. "in band" and "outside" are the shares of '
        'residuals inside the 95 % prediction band, within and outside the trained range.',
        'quiet')


def _regions(contents: Contents) -> str:
    lines = [f'{name} {region.words}' for name in contents.joints
             for region in contents.comparison.joints[name].where[:REPORT.max_regions]]
    outside = contents.comparison.share_outside
    if outside > 0.0:
        lines.insert(0, f'{100 * outside:.1f} % of these samples are outside the trained poses')
    if not lines:
        return markup.paragraph('No joint has a region of larger error.', 'quiet')
    return '<h3>Regions of large error</h3>' + markup.bullets(lines)


# Column of the quantity over which the residual shows an effect of one joint.
_OVER = {'speed': 'v', 'position': 'q', 'load': 'p', 'time': 't'}


def section(contents: Contents, table: Table) -> Section:
    """Return the errors of every joint, the evidence plot, the next command, and the regions."""
    finding = main_finding(contents)
    evidence = _evidence(contents, table, finding)
    evidence.height, evidence.toolbar_location = 300, 'above'
    after = ''
    if contents.next_command:
        after = '<h3>Next step</h3>' + markup.command(contents.next_command)
    elif finding is not None and finding.next_step:
        after = markup.paragraph(f'Next: {finding.next_step}', 'quiet')
    return Section('summary', 'Error of each joint', _errors(contents), evidence,
                   after + _regions(contents) + _explanation(contents))


def _evidence(contents: Contents, table: Table, finding: Finding | None) -> figure:
    """Return the plot that shows the finding, or the largest error without a finding."""
    effect = None if finding is None else all_effects().get(finding.effect or '')
    letter = _OVER.get(effect.signature, '') if effect and effect.scope == 'joint' else ''
    if finding is not None and contents.diagnosis is not None and not letter:
        plots = effects.added(contents, table, [contents.diagnosis.findings.index(finding)])
        if plots:
            return plots[0]
    joint = finding.joint if finding is not None and finding.joint in contents.joints else \
        contents.worst
    return residuals.against(contents, table, contents.model.joints.index(joint), letter or 'q')
