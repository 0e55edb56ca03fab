"""
Findings of the diagnosis: table and added-variable plots.

An added-variable plot shows the torque that an effect explains in addition to the model and all
other effects. X are the regressor columns of the effect, Z those of the other effects, of all
joints, and r is the residual of the model. c and d minimise |r - X c - Z d|; the axes are x = X c
and y = r - Z d. A present effect gives points along the line y = x. A curved pattern, or a line
determined by a few points, is evidence against the effect.
"""

from __future__ import annotations

from collections.abc import Sequence

from bokeh.models import Label, Slope
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.predict import motion_of
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, REPORT, Table
from gravity_comp_ros.report.section import Section, tiles
from gravity_comp_ros.report.style import MARKED, plot, PREDICTED, RESIDUAL, TEXT
from gravity_comp_ros.report.views import residuals
import numpy as np


def added_variable(motion: Motion, joints: Sequence[str], residual: FloatArray, finding: Finding,
                   others: Sequence[Finding], rows: IntArray
                   ) -> tuple[str, FloatArray, FloatArray] | None:
    """
    Return the joint of the torque, x (R,) and y (R,) in N·m of an added-variable plot.

    It is None if this motion gives no columns.

    :param motion: motion of all samples, as recorded.
    :param residual: measured minus predicted torque (M, N) of the joints in N·m.
    :param others: other findings, whose columns are Z.
    :param rows: indices of the samples to plot (R,).
    """
    own = _columns(motion, joints, finding, rows)
    if own is None:
        return None
    columns = [own, *(each for other in others
                      if (each := _columns(motion, joints, other, rows)) is not None)]
    stacked = np.concatenate(columns, axis=2)
    r = residual[rows]
    c = lstsq(stacked.reshape(r.size, -1), r.ravel(), rcond=1e-8)
    x = own @ c[:own.shape[2]]
    y = r - stacked @ c + x
    # An effect of the whole arm is shown on the joint where it explains most.
    joint = int(np.argmax((x ** 2).sum(axis=0)))
    return joints[joint], x[:, joint], y[:, joint]


def _columns(motion: Motion, joints: Sequence[str], of: Finding, rows: IntArray
             ) -> FloatArray | None:
    """Return the columns (R, N, K) of an effect in the torques, None without any."""
    effect = all_effects().get(of.effect or '')
    if effect is None or of.joint not in (None, *joints):
        return None
    number = 0 if of.joint is None else joints.index(of.joint)
    try:
        columns = effect.columns(motion, number, of.setting)[rows]
    except (KeyError, ValueError, IndexError):
        return None
    if columns.ndim == 3:
        return columns
    result = np.zeros((len(rows), len(joints), columns.shape[1]))
    result[:, number] = columns
    return result


# Name of a finding that no effect describes.
_UNKNOWN = 'unexplained'


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
    lead += markup.units(diagnosis.table().html())
    plots = added(contents, table, range(min(len(findings), REPORT.max_plots)))
    explanation = ''
    if plots:
        explanation = markup.paragraph(
            'The plots are added-variable plots: on the x axis the torque that the effect '
            'explains in addition to the model and the other effects, on the y axis the measured '
            'torque without them. Points along the line confirm the effect; a curved pattern, or '
            'a line determined by few points, is evidence against it.', 'quiet')
    return Section('effects', title, lead, tiles(plots, 300) if plots else None,
                   explanation + details(findings) + summaries(diagnosis))


def details(findings: tuple[Finding, ...]) -> str:
    """Return the evidence and the next step of each finding."""
    parts = [f'<p><b>{k + 1}. {markup.text(f.effect or _UNKNOWN)}</b> on '
             f'{markup.text(wording.where(f))}: '
             f'{markup.text(f.why)}{"; alternative: " * bool(f.rivals)}'
             f'{markup.text(", ".join(f.rivals))}.<br>'
             f'{markup.text("Next: " + (f.next_step or "add it"))}</p>'
             for k, f in enumerate(findings)]
    return markup.folded('Evidence and next steps', ''.join(parts))


def summaries(diagnosis: Diagnosis) -> str:
    """Return a table with a summary of every joint, and the untestable effects."""
    rows = [[name, r.summary, f'{r.noise_floor:.3g}', f'{r.n_effective:.0f}',
             f'{r.rmse_before:.3g}', f'{r.rmse_after:.3g}'] for name, r in
            diagnosis.joints.items()]
    table = TextTable(('joint', 'result', 'sensor noise N·m', 'effective sample size',
                       'held-out RMSE before N·m', 'after N·m'), rows).html()
    lines = wording.untestable(diagnosis)
    untestable = markup.folded(f'Effects that are not identifiable from this recording '
                               f'({len(lines)})', markup.bullets(lines)) if lines else ''
    return table + untestable


def added(contents: Contents, table: Table, numbers: Sequence[int]) -> list[figure]:
    """
    Return the added-variable plots of findings by number, of those that have columns.

    An unexplained residual of a joint is shown against its position.
    """
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    motion, joints, plots = motion_of(contents.model, contents.samples), contents.joints, []
    for k in numbers:
        finding = findings[k]
        others = [f for f in findings if f is not finding and f.is_missing]
        variable = added_variable(motion, contents.model.joints, contents.residual, finding,
                                  others, table.drawn)
        if variable is not None:
            joint, x, y = variable
            plots.append(_plot(f'{k + 1}  {finding.effect} · {joint}', x, y, table, k))
        elif finding.effect is None and finding.joint in joints:
            plots.append(residuals.against(
                contents, table, contents.model.joints.index(finding.joint), 'q'))
    return plots


def _plot(title: str, x: FloatArray, y: FloatArray, table: Table, k: int) -> figure:
    total = float((y ** 2).sum())
    share = max(1.0 - float(((y - x) ** 2).sum()) / total, 0.0) if total > 0.0 else 0.0
    table.add({f'ax{k}': table.spread(x), f'ay{k}': table.spread(y)})
    fig = plot(title, 'explained by the effect, N·m', 'measured, N·m', 250,
               tools='pan,box_zoom,wheel_zoom,box_select,lasso_select,hover,reset,save')
    fig.scatter(f'ax{k}', f'ay{k}', source=table.source, size=3, line_color=None,
                fill_color=RESIDUAL, fill_alpha=0.4, selection_fill_color=MARKED,
                selection_fill_alpha=0.95, nonselection_fill_alpha=0.12,
                nonselection_line_color=None, selection_line_color=None)
    fig.xaxis.ticker.desired_num_ticks = 4
    fig.hover.tooltips = [('explained', f'@ax{k}{{0.000}}'), ('measured', f'@ay{k}{{0.000}}'),
                          ('time', '@t{0.00} s')]
    fig.add_layout(Slope(gradient=1.0, y_intercept=0.0, line_color=PREDICTED, line_width=2))
    fig.add_layout(Label(x=6, y=4, x_units='screen', y_units='screen',
                         text=f'explains {100 * share:.0f} %', text_color=TEXT,
                         text_font_size='12px', background_fill_color='white',
                         background_fill_alpha=0.8))
    return fig
