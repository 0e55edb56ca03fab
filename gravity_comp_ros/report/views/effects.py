"""Findings of the diagnosis: table, errors without and with them, added-variable plots."""

from __future__ import annotations

from bokeh.layouts import column, gridplot
from bokeh.models import Label, Slope, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.display import percent
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.predict import motion_of
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.added_variable import added_variable, AddedVariable
from gravity_comp_ros.report.bars import bar_key, bar_plot, Bars
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section, tiles
from gravity_comp_ros.report.style import (
    AFTER, BEFORE, MARKED, plot, PREDICTED, RESIDUAL, short, TEXT)
from gravity_comp_ros.report.table import Table

_MAX_PLOTS = 9
_MAX_BARS, _MAX_NAME = 15, 48
_MAX_COEFFICIENTS = 4


def section(contents: Contents, table: Table) -> Section:
    """Return the findings of the diagnosis, or a text without plots if there are none."""
    title = 'Missing effects'
    diagnosis = contents.diagnosis
    if diagnosis is None:
        return Section('effects', title, markup.paragraph(
            'This report has no diagnosis: `gravity_comp diagnose --html` identifies missing '
            'effects.'))
    if not diagnosis.findings:
        return Section('effects', title, markup.paragraph(wording.verdict(diagnosis))
                       + summaries(diagnosis))
    findings = diagnosis.findings
    lead = markup.paragraph(
        'Findings are ranked by evidence. Errors are held-out errors, each with the effects above '
        'it, relative to the range of the measured torque.', 'quiet')
    bars = findings[:_MAX_BARS]
    lead += findings_table(findings) + bar_key(_bars(bars))
    # A separate grid, because Bokeh lays out a plot next to a grid incorrectly.
    parts: list[UIElement] = [gridplot([[_bar_plot(bars)]],
                                       sizing_mode='stretch_width', toolbar_location=None)]
    plots = _added_variable_plots(contents, table)
    explanation = ''
    if plots is not None:
        parts.append(plots)
        explanation = markup.paragraph(
            'The small plots are added-variable plots: on the x axis the torque that the effect '
            'explains in addition to gravity and the other effects, on the y axis the measured '
            'torque without them. Points along the line confirm the effect; a curved pattern, or '
            'a line determined by few points, is evidence against it.', 'quiet')
    return Section('effects', title, lead, column(*parts, sizing_mode='stretch_width'),
                   explanation + details(findings) + summaries(diagnosis))


def findings_table(findings: tuple[Finding, ...]) -> str:
    """Return the ranked findings as a table."""
    rows = [[f'{k + 1}  {label(f)}', wording.where(f), f.verdict, coefficients(f),
             wording.change(f),
             percent(f.base_absorbed), f'{100 * f.runs_better:.0f} %',
             ', '.join(f.rivals) or '–'] for k, f in enumerate(findings)]
    return markup.table(
        ['effect', 'where', 'verdict', 'coefficients, 95 %', 'held-out error',
         'absorbed by gravity', 'improved runs', 'alternatives'], rows,
        left=('where', 'verdict', 'coefficients, 95 %', 'alternatives'))


def label(finding: Finding) -> str:
    """Return the name of the effect, or 'unexplained'."""
    return finding.effect or 'unexplained'


def coefficients(finding: Finding, max_count: int = _MAX_COEFFICIENTS) -> str:
    """Return at most `max_count` coefficients with units and 95 % intervals in one line."""
    return markup.units(wording.coefficients(finding.coefficients, max_count))


def _bars(findings: tuple[Finding, ...]) -> list[Bars]:
    """Return the bars of the held-out errors without and with each finding."""
    return [Bars('without it', [100.0 * f.nrmse_before for f in findings], BEFORE),
            Bars('with it', [100.0 * f.nrmse_after for f in findings], AFTER)]


def _bar_plot(findings: tuple[Finding, ...]) -> figure:
    names = [f'{k + 1}  {label(f)} · {short(f.joint or "whole arm")}'
             for k, f in enumerate(findings)]
    return bar_plot('held-out error, % of the range of the torque', names, _bars(findings),
                    '0.00', _MAX_NAME)


def details(findings: tuple[Finding, ...]) -> str:
    """Return the evidence and the next step of each finding."""
    parts = [f'<p><b>{k + 1}. {markup.text(label(f))}</b> on {markup.text(wording.where(f))}: '
             f'{markup.text(f.why)}.<br>{markup.text("Next: " + (f.next_step or "add it"))}</p>'
             for k, f in enumerate(findings)]
    return markup.folded('Evidence and next steps', ''.join(parts))


def summaries(diagnosis: Diagnosis) -> str:
    """Return a table with a summary of every joint, and the untestable effects."""
    rows = [[name, r.summary, f'{r.noise_floor:.3g}', f'{r.n_effective:.0f}',
             f'{r.rmse_before:.3g}', f'{r.rmse_after:.3g}'] for name, r in
            diagnosis.joints.items()]
    table = markup.table(['joint', 'result', 'sensor noise N·m', 'effective sample size',
                          'held-out RMSE before N·m', 'after N·m'], rows, left=('result',))
    lines = wording.untestable(diagnosis)
    untestable = markup.folded(f'Effects that are not identifiable from this recording '
                               f'({len(lines)})', markup.bullets(lines)) if lines else ''
    return table + untestable


def _added_variable_plots(contents: Contents, table: Table) -> UIElement | None:
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    motion = motion_of(contents.model, contents.samples)
    variables = [(k, variable) for k, finding in enumerate(findings[:_MAX_PLOTS])
                 if (variable := _variable(contents, table, motion, finding))]
    if not variables:
        return None
    table.add({f'ax{k}': table.spread(variable.x) for k, variable in variables}
              | {f'ay{k}': table.spread(variable.y) for k, variable in variables})
    return tiles([_plot(variable, table, k) for k, variable in variables], 300)


def added(contents: Contents, table: Table, finding: Finding) -> figure | None:
    """Return the added-variable plot of one finding."""
    motion = motion_of(contents.model, contents.samples)
    variable = _variable(contents, table, motion, finding)
    if variable is None or contents.diagnosis is None:
        return None
    table.add({'ax_first': table.spread(variable.x), 'ay_first': table.spread(variable.y)})
    return _plot(variable, table, contents.diagnosis.findings.index(finding), '_first')


def _variable(contents: Contents, table: Table, motion: Motion,
              finding: Finding) -> AddedVariable | None:
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    others = [f for f in findings if f is not finding and f.is_missing]
    return added_variable(motion, contents.model, finding, others, table.drawn)


def _plot(variable: AddedVariable, table: Table, k: int, column_name: str = '') -> figure:
    name = column_name or str(k)
    x = 'angle, rad' if variable.is_angle else 'explained by the effect, N·m'
    fig = plot(f'{k + 1}  {label(variable.finding)} · {variable.joint}', x,
               'measured, N·m', 250,
               tools='pan,box_zoom,wheel_zoom,box_select,lasso_select,hover,reset,save')
    fig.scatter(f'ax{name}', f'ay{name}', source=table.source, size=3, line_color=None,
                fill_color=RESIDUAL, fill_alpha=0.4, selection_fill_color=MARKED,
                selection_fill_alpha=0.95, nonselection_fill_alpha=0.12,
                nonselection_line_color=None, selection_line_color=None)
    fig.xaxis.ticker.desired_num_ticks = 4
    fig.hover.tooltips = [(x.split(',')[0], f'@ax{name}{{0.000}}'),
                          ('measured', f'@ay{name}{{0.000}}'),
                          ('time', '@t{0.00} s')]
    if not variable.is_angle:
        fig.add_layout(Slope(gradient=1.0, y_intercept=0.0, line_color=PREDICTED,
                             line_width=2))
        fig.add_layout(Label(x=6, y=4, x_units='screen', y_units='screen',
                             text=f'explains {100 * max(variable.share, 0.0):.0f} %',
                             text_color=TEXT, text_font_size='12px',
                             background_fill_color='white',
                             background_fill_alpha=0.8))
    return fig
