"""The answer on one screen: the error of each joint, the plot that shows why, what to do next."""

from __future__ import annotations

from bokeh.layouts import row
from bokeh.models import UIElement
from bokeh.plotting import figure
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.bars import bar_key, bar_plot, Bars
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.headline import named_joint, visible
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.report.views import effects, residuals

# Over what the residual of an effect is plain; of others the added-variable plot is shown.
_OVER = {'coulomb_friction': 'v', 'viscous_friction': 'v', 'stribeck_friction': 'v',
         'degressive_friction': 'v', 'asymmetric_friction': 'v', 'presliding_hysteresis': 'v',
         'joint_spring': 'q', 'cable_stiffness': 'q', 'torque_ripple': 'q', 'end_stop': 'q',
         'torque_gain': 'p', 'load_dependent_friction': 'p', 'torque_drift': 't',
         'friction_drift': 't', 'torque_offset': 'q'}


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return bars for every joint, a plot, and the next command."""
    bars = error_bars(contents, style)
    finding = telling(contents)
    shown: list[UIElement] = [_drawn(contents, bars, style)]
    after = ''
    proof = _proof(contents, table, style, finding)
    if proof is not None:
        shown.append(proof)
    if finding is not None and finding.next_step and not contents.next_command:
        after += markup.paragraph(f'Next: {finding.next_step}', 'quiet')
    if contents.next_command:
        after += '<h3>What to do next</h3>' + markup.command(contents.next_command)
    return Section('answer', 'Error of each joint', bar_key(bars),
                   row(*shown, sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'}), after)


def telling(contents: Contents) -> Finding | None:
    """Return the finding that the headline names, if it shows in the error."""
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    return findings[0] if findings and visible(findings[0]) else None


def error_bars(contents: Contents, style: Style) -> list[Bars]:
    """Return the bars of every joint, in N·m."""
    diagnosis, joints = contents.diagnosis, contents.joints
    if diagnosis is not None and all(name in diagnosis.joints for name in joints):
        found = [diagnosis.joints[name] for name in joints]
        rows = [Bars('noise of the sensor', [r.noise_floor for r in found], style.still),
                Bars('held-out error now', [r.rmse_before for r in found], style.down)]
        if any(visible(f) for f in diagnosis.findings):
            rows.append(Bars('with the effects below', [r.rmse_after for r in found],
                             style.after))
        return rows
    noise = contents.model.noise[contents.numbers].tolist()
    now = [contents.comparison.joints[name].rmse for name in joints]
    rows = [Bars('in training', noise, style.still), Bars('now', now, style.after)]
    if contents.previous:
        before = [contents.previous.get(name, float('nan')) for name in joints]
        rows.insert(1, Bars(contents.previous_name, before, style.down))
    return rows


def _drawn(contents: Contents, bars: list[Bars], style: Style) -> figure:
    made = bar_plot(style, '', 'RMSE, N·m', _height(len(contents.joints)), contents.joints, bars,
                    '0.0000')
    made.styles = {'flex': '1 1 300px', 'width': 'auto'}
    return made


def _height(joints: int) -> int:
    return 62 + 36 * joints


def _proof(contents: Contents, table: Table, style: Style,
           finding: Finding | None) -> UIElement | None:
    """Return the plot in which the finding, or else the largest error, is plain."""
    joint = named_joint(contents)
    letter = 'q' if finding is None else _OVER.get(finding.effect or '', '')
    height = max(280, min(_height(len(contents.joints)), 420))
    if finding is not None and not letter:
        made = effects.added(contents, table, style, finding)
        if made is None:
            letter = 'q'
        else:
            made.height = height
    if letter:
        made = residuals.one(contents, table, style, joint, letter, height)
    if made is None:
        return None
    made.toolbar_location = 'above'
    made.styles = {'flex': '2 1 300px', 'width': 'auto'}
    return made
