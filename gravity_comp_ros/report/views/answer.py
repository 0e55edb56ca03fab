"""The answer on one screen: the error of each joint, the plot that shows why, what to do next."""

from __future__ import annotations

from bokeh.layouts import row
from bokeh.models import ColumnDataSource, FixedTicker, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.headline import named_joint, visible
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import canvas_text, plot, short, Style
from gravity_comp_ros.report.views import effects, residuals

_BAR = 0.26
# Over what the residual of an effect is plain; of others the added-variable plot is shown.
_OVER = {'coulomb_friction': 'v', 'viscous_friction': 'v', 'stribeck_friction': 'v',
         'asymmetric_friction': 'v', 'presliding_hysteresis': 'v', 'joint_spring': 'q',
         'cable_stiffness': 'q', 'torque_ripple': 'q', 'end_stop': 'q', 'torque_gain': 'p',
         'load_dependent_friction': 'p', 'torque_drift': 't', 'friction_drift': 't',
         'torque_offset': 'q'}
Bars = tuple[str, list[float], str]


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return bars for every joint, a plot, and the next command."""
    bars = error_bars(contents, style)
    lead = markup.key([(colour, name) for name, _, colour in bars])
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
    return Section('answer', 'Error of each joint', lead,
                   row(*shown, sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'}), after)


def telling(contents: Contents) -> Finding | None:
    """Return the finding that the headline names, if it shows in the error."""
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    return findings[0] if findings and visible(findings[0]) else None


def error_bars(contents: Contents, style: Style) -> list[Bars]:
    """Return the rows of bars: what they are, N·m for each joint, and their colour."""
    diagnosis, joints = contents.diagnosis, contents.joints
    if diagnosis is not None and all(name in diagnosis.joints for name in joints):
        found = [diagnosis.joints[name] for name in joints]
        rows = [('noise of the sensor', [r.noise_floor for r in found], style.still),
                ('held-out error now', [r.rmse_before for r in found], style.down)]
        if any(visible(f) for f in diagnosis.findings):
            rows.append(('with the effects below', [r.rmse_after for r in found], style.after))
        return rows
    noise = contents.model.noise[contents.numbers].tolist()
    now = [contents.comparison.joints[name].rmse for name in joints]
    rows = [('in training', noise, style.still), ('now', now, style.after)]
    if contents.previous:
        before = [contents.previous.get(name, float('nan')) for name in joints]
        rows.insert(1, (contents.previous_name, before, style.down))
    return rows


def _drawn(contents: Contents, bars: list[Bars], style: Style) -> figure:
    joints = contents.joints
    count = len(joints)
    # Names may be alike once they are printable, so joints stand at numbers.
    made = plot(style, '', 'RMSE, N·m', '', _height(count), 'hover',
                y_range=(count - 0.45, -0.55))
    for place, (name, values, colour) in enumerate(bars):
        shift = (place - 0.5 * (len(bars) - 1)) * _BAR
        source = ColumnDataSource({
            'y': [k + shift for k in range(count)], 'right': values,
            'what': [canvas_text(printable(name))] * count,
            'joint': [canvas_text(printable(joint)) for joint in joints]})
        made.hbar('y', right='right', height=0.9 * _BAR, source=source, color=colour)
    made.yaxis.ticker = FixedTicker(ticks=list(range(count)))
    made.yaxis.major_label_overrides = {
        k: canvas_text(short(printable(joint))) for k, joint in enumerate(joints)}
    made.ygrid.visible = False
    made.x_range.start = 0.0
    made.hover.tooltips = [('joint', '@joint'), ('RMSE', '@right{0.0000} N·m'), ('', '@what')]
    made.toolbar_location = None
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
