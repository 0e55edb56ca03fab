"""First section: error of each joint, plot of the main finding, and the next command."""

from __future__ import annotations

from bokeh.layouts import row
from bokeh.models import UIElement
from bokeh.plotting import figure
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.bars import bar_key, bar_plot, Bars
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.headline import main_finding, named_joint
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.style import AFTER, DOWN, STILL
from gravity_comp_ros.report.table import Table
from gravity_comp_ros.report.views import effects, residuals

# Column against which the residual shows an effect; other effects get an added-variable plot.
_AGAINST = {'coulomb_friction': 'v', 'viscous_friction': 'v', 'stribeck_friction': 'v',
            'degressive_friction': 'v', 'asymmetric_friction': 'v', 'presliding_hysteresis': 'v',
            'joint_spring': 'q', 'cable_stiffness': 'q', 'torque_ripple': 'q', 'end_stop': 'q',
            'torque_gain': 'p', 'load_dependent_friction': 'p', 'torque_drift': 't',
            'friction_drift': 't', 'torque_offset': 'q'}


def section(contents: Contents, table: Table) -> Section:
    """Return bars for every joint, the evidence plot, and the next command."""
    bars = error_bars(contents)
    finding = main_finding(contents)
    errors = bar_plot('RMSE, N·m', contents.joints, bars, '0.0000')
    errors.styles = {'flex': '1 1 300px', 'width': 'auto'}
    evidence = _evidence(contents, table, finding)
    evidence.height = max(280, min(errors.height, 420))
    evidence.toolbar_location = 'above'
    evidence.styles = {'flex': '2 1 300px', 'width': 'auto'}
    plots: list[UIElement] = [errors, evidence]
    after = ''
    if contents.next_command:
        after = '<h3>Next step</h3>' + markup.command(contents.next_command)
    elif finding is not None and finding.next_step:
        after = markup.paragraph(f'Next: {finding.next_step}', 'quiet')
    return Section('summary', 'Error of each joint', bar_key(bars),
                   row(*plots, sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'}), after)


def error_bars(contents: Contents) -> list[Bars]:
    """Return the bars of the errors of every joint, in N·m: those of the table of errors."""
    joints = contents.joints
    bars = [Bars('in training', contents.model.noise[contents.numbers].tolist(), STILL),
            Bars('on these samples', [contents.comparison.joints[name].rmse for name in joints],
                 AFTER)]
    if contents.previous:
        before = [contents.previous.get(name, float('nan')) for name in joints]
        bars.insert(1, Bars(contents.previous_name, before, DOWN))
    return bars


def _evidence(contents: Contents, table: Table, finding: Finding | None) -> figure:
    """Return the plot that shows the finding, or the largest error without a finding."""
    letter = 'q' if finding is None else _AGAINST.get(finding.effect or '', '')
    if finding is not None and not letter:
        fig = effects.added(contents, table, finding)
        if fig is not None:
            return fig
    return residuals.against(contents, table, contents.model.joints.index(named_joint(contents)),
                             letter or 'q')
