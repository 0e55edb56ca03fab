"""First section: error of each joint, plot of the main finding, and the next command."""

from __future__ import annotations

from bokeh.layouts import row
from bokeh.models import UIElement
from bokeh.plotting import figure
from gravity_comp_ros.diagnosis.findings import Finding, FOUND
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.bars import bar_key, bar_plot, Bars
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.headline import named_joint, visible
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.report.views import effects, residuals

# Column against which the residual shows an effect; other effects get an added-variable plot.
_AGAINST = {'coulomb_friction': 'v', 'viscous_friction': 'v', 'stribeck_friction': 'v',
            'degressive_friction': 'v', 'asymmetric_friction': 'v', 'presliding_hysteresis': 'v',
            'joint_spring': 'q', 'cable_stiffness': 'q', 'torque_ripple': 'q', 'end_stop': 'q',
            'torque_gain': 'p', 'load_dependent_friction': 'p', 'torque_drift': 't',
            'friction_drift': 't', 'torque_offset': 'q'}


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return bars for every joint, the evidence plot, and the next command."""
    bars = error_bars(contents, style)
    finding = main_finding(contents)
    plots: list[UIElement] = [_error_plot(contents, bars, style)]
    after = ''
    evidence = _evidence_plot(contents, table, style, finding)
    if evidence is not None:
        plots.append(evidence)
    if finding is not None and finding.next_step and not contents.next_command:
        after += markup.paragraph(f'Next: {finding.next_step}', 'quiet')
    if contents.next_command:
        after += '<h3>Next step</h3>' + markup.command(contents.next_command)
    return Section('summary', 'Error of each joint', bar_key(bars),
                   row(*plots, sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'}), after)


def main_finding(contents: Contents) -> Finding | None:
    """Return the finding of the headline, if it reduces the error visibly."""
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    return findings[0] if findings and visible(findings[0]) else None


def error_bars(contents: Contents, style: Style) -> list[Bars]:
    """Return the bars of the errors of every joint, in N·m."""
    diagnosis, joints = contents.diagnosis, contents.joints
    if diagnosis is not None and all(name in diagnosis.joints for name in joints):
        reports = [diagnosis.joints[name] for name in joints]
        bars = [Bars('sensor noise', [r.noise_floor for r in reports], style.still),
                Bars('held-out error', [r.rmse_before for r in reports], style.down)]
        if any(f.verdict in FOUND for f in diagnosis.findings):
            bars.append(Bars('with the effects to add', [r.rmse_after for r in reports],
                             style.after))
        return bars
    noise = contents.model.noise[contents.numbers].tolist()
    now = [contents.comparison.joints[name].rmse for name in joints]
    bars = [Bars('in training', noise, style.still), Bars('on these samples', now, style.after)]
    if contents.previous:
        before = [contents.previous.get(name, float('nan')) for name in joints]
        bars.insert(1, Bars(contents.previous_name, before, style.down))
    return bars


def _error_plot(contents: Contents, bars: list[Bars], style: Style) -> figure:
    fig = bar_plot(style, '', 'RMSE, N·m', _height(len(contents.joints)), contents.joints, bars,
                   '0.0000')
    fig.styles = {'flex': '1 1 300px', 'width': 'auto'}
    return fig


def _height(joints: int) -> int:
    return 62 + 36 * joints


def _evidence_plot(contents: Contents, table: Table, style: Style,
                   finding: Finding | None) -> UIElement | None:
    """Return the plot that shows the finding, or the largest error without a finding."""
    joint = named_joint(contents)
    letter = 'q' if finding is None else _AGAINST.get(finding.effect or '', '')
    height = max(280, min(_height(len(contents.joints)), 420))
    if finding is not None and not letter:
        fig = effects.added(contents, table, style, finding)
        if fig is None:
            letter = 'q'
        else:
            fig.height = height
    if letter:
        fig = residuals.one(contents, table, style, joint, letter, height)
    if fig is None:
        return None
    fig.toolbar_location = 'above'
    fig.styles = {'flex': '2 1 300px', 'width': 'auto'}
    return fig
