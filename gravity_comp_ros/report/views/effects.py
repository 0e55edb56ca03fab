"""The ranked effects: what each is, before and after, and its added-variable plot."""

from __future__ import annotations

from bokeh.layouts import column, gridplot
from bokeh.models import Label, Slope, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.api import results
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.effects.motion import build_motion, Motion
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.added_variable import added_variable, AddedVariable
from gravity_comp_ros.report.bars import bar_key, bar_plot, Bars
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import plot, short, Style
from gravity_comp_ros.report.tiles import tiles

_MOST_PLOTS, _COLUMNS = 9, 3
_MOST_BARS, _LONGEST = 15, 48
_MOST_COEFFICIENTS = 4


def section(contents: Contents, table: Table, style: Style) -> Section:
    """Return the findings of the diagnosis; words alone where there are none."""
    title = 'What is missing'
    diagnosis = contents.diagnosis
    if diagnosis is None:
        return Section('effects', title, markup.paragraph(
            'No diagnosis was made for this report: `gravity_comp diagnose --html` names the '
            'effects that the model lacks.'))
    if not diagnosis.findings:
        return Section('effects', title, markup.paragraph(wording.verdict(diagnosis))
                       + structure(diagnosis) + summaries(diagnosis))
    findings = diagnosis.findings
    lead = markup.paragraph(
        'Ranked by how sure they are. Errors are of data that was not fitted, each with the '
        'effects above it, as a share of the range of the measured torque.', 'quiet')
    shown = findings[:_MOST_BARS]
    lead += findings_table(findings) + bar_key(_bars(shown, style))
    # A grid of its own, because a plot beside a grid is laid out wrongly in an open page.
    parts: list[UIElement] = [gridplot([[_bar_plot(shown, style)]],
                                       sizing_mode='stretch_width', toolbar_location=None)]
    drawn = _added(contents, table, style)
    if drawn is not None:
        parts.append(drawn)
    return Section('effects', title, lead, column(*parts, sizing_mode='stretch_width'),
                   _explained(drawn is not None) + structure(diagnosis) + details(findings)
                   + summaries(diagnosis))


def findings_table(findings: tuple[Finding, ...]) -> str:
    """Return the ranked findings as a table."""
    rows = [[f'{k + 1}  {label(f)}', wording.where(f), f.verdict, coefficients(f),
             wording.change(f),
             wording.percent(f.base_absorbed), f'{100 * f.runs_better:.0f} %',
             ', '.join(f.rivals) or '–'] for k, f in enumerate(findings)]
    return markup.table(
        ['effect', 'where', 'verdict', 'coefficients, 95 %', 'held-out error',
         'gravity imitates', 'runs better', 'or rather'], rows,
        left=('where', 'verdict', 'coefficients, 95 %', 'or rather'))


def label(finding: Finding) -> str:
    """Return an effect's name; something unexplained has none."""
    return finding.effect or 'unexplained'


def coefficients(finding: Finding, most: int = _MOST_COEFFICIENTS) -> str:
    """Return at most so many coefficients with units and 95 % intervals in one line."""
    return markup.units(results.coefficients(finding, most))


def _bars(findings: tuple[Finding, ...], style: Style) -> list[Bars]:
    """Return the held-out error of each finding without and with it."""
    return [Bars('without it', [100.0 * f.nrmse_before for f in findings], style.before),
            Bars('with it', [100.0 * f.nrmse_after for f in findings], style.after)]


def _bar_plot(findings: tuple[Finding, ...], style: Style) -> figure:
    names = [f'{k + 1}  {label(f)} · {short(f.joint or "whole arm")}'
             for k, f in enumerate(findings)]
    return bar_plot(style, 'Held-out error without and with each', '% of the range of the torque',
                    72 + 38 * len(names), names, _bars(findings, style), '0.00', _LONGEST)


def details(findings: tuple[Finding, ...]) -> str:
    """Return why each finding is believed, and what to do next."""
    parts = [f'<p><b>{k + 1}. {markup.text(label(f))}</b> on {markup.text(wording.where(f))}: '
             f'{markup.text(f.why)}.<br>{markup.text("Next: " + (f.next_step or "add it"))}</p>'
             for k, f in enumerate(findings)]
    return markup.folded('Why, and what to do next', ''.join(parts))


def summaries(diagnosis: Diagnosis) -> str:
    """Return a word on every joint, and what this recording cannot show."""
    rows = [[name, r.summary, f'{r.noise_floor:.3g}', f'{r.n_effective:.0f}',
             f'{r.rmse_before:.3g}', f'{r.rmse_after:.3g}'] for name, r in
            diagnosis.joints.items()]
    table = markup.table(['joint', 'found', 'sensor noise N·m', 'independent samples',
                          'held-out RMSE before N·m', 'and after N·m'], rows, left=('found',))
    grouped: dict[tuple[str, str], list[str]] = {}
    for name, report in diagnosis.joints.items():
        for effect, reason in report.untestable.items():
            grouped.setdefault((effect, reason), []).append(name)
    lines = [f'{effect} on {", ".join(joints)}: {reason}'
             for (effect, reason), joints in grouped.items()]
    unseen = markup.folded(f'What this recording cannot show ({len(lines)})',
                           markup.bullets(lines)) if lines else ''
    return table + unseen


def structure(diagnosis: Diagnosis) -> str:
    """Return what the torques do that no gravity of a serial arm does; nothing for nothing."""
    lines = results.structure_lines(diagnosis)
    return '<h3>What no gravity of a serial arm does</h3>' + markup.bullets(lines) if lines else ''


def _explained(is_drawn: bool) -> str:
    return markup.paragraph(
        'The small plots are added-variable plots: across, what the effect explains that '
        'gravity and the other effects cannot; upwards, what is measured of it. Points along '
        'the line speak for the effect; a bend, or few points that carry the line, against '
        'it.', 'quiet') if is_drawn else ''


def _added(contents: Contents, table: Table, style: Style) -> UIElement | None:
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    motion = build_motion(contents.samples, contents.model)
    plots = [(k, found) for k, finding in enumerate(findings[:_MOST_PLOTS])
             if (found := _variable(contents, table, motion, finding))]
    if not plots:
        return None
    table.add({f'ax{k}': table.spread(found.x) for k, found in plots}
              | {f'ay{k}': table.spread(found.y) for k, found in plots})
    made = [_plot(found, table, style, k) for k, found in plots]
    rows = [made[k:k + _COLUMNS] for k in range(0, len(made), _COLUMNS)]
    return tiles(rows, 300)


def added(contents: Contents, table: Table, style: Style, finding: Finding) -> figure | None:
    """Return the added-variable plot of one finding, by itself."""
    motion = build_motion(contents.samples, contents.model)
    found = _variable(contents, table, motion, finding)
    if found is None or contents.diagnosis is None:
        return None
    table.add({'ax_first': table.spread(found.x), 'ay_first': table.spread(found.y)})
    return _plot(found, table, style, contents.diagnosis.findings.index(finding),
                 '_first')


def _variable(contents: Contents, table: Table, motion: Motion,
              finding: Finding) -> AddedVariable | None:
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    others = [f for f in findings if f is not finding and f.verdict in wording.FOUND]
    return added_variable(motion, contents.model, finding, others, table.drawn)


def _plot(found: AddedVariable, table: Table, style: Style, k: int,
          column_name: str = '') -> figure:
    name = column_name or str(k)
    x = 'angle, rad' if found.is_angle else 'explained by it alone, N·m'
    made = plot(style, printable(f'{k + 1}  {label(found.finding)} · {found.joint}'), x,
                'measured, N·m', 250,
                tools='pan,box_zoom,wheel_zoom,box_select,lasso_select,hover,reset,save')
    made.scatter(f'ax{name}', f'ay{name}', source=table.source, size=3, line_color=None,
                 fill_color=style.residual, fill_alpha=0.4, selection_fill_color=style.marked,
                 selection_fill_alpha=0.95, nonselection_fill_alpha=0.12,
                 nonselection_line_color=None, selection_line_color=None)
    made.xaxis.ticker.desired_num_ticks = 4
    made.hover.tooltips = [(x.split(',')[0], f'@ax{name}{{0.000}}'),
                           ('measured', f'@ay{name}{{0.000}}'),
                           ('time', '@t{0.00} s')]
    if not found.is_angle:
        made.add_layout(Slope(gradient=1.0, y_intercept=0.0, line_color=style.predicted,
                              line_width=2))
        made.add_layout(Label(x=6, y=4, x_units='screen', y_units='screen',
                              text=f'explains {100 * max(found.share, 0.0):.0f} %',
                              text_color=style.text, text_font_size='12px',
                              background_fill_color=style.background,
                              background_fill_alpha=0.8))
    return made
