"""Panels of the page: findings with buttons, planned motion, error history."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.models.applied_effects import target as effect_name
from gravity_comp_ros.planning.expected import EXPECTED, MotionPlan
from gravity_comp_ros.planning.questions import OPEN
from gravity_comp_ros.report import markup
from gravity_comp_ros.workbench.jobs import Step
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.widgets import button, download, select

# Number of findings shown at first, so that the first view fits on the same screen.
_AT_FIRST, _MAX_COEFFICIENTS = 3, 1
# Maximum number of stages in the history; each compares its model on all samples.
_MAX_STAGES = 8


def findings_html(results: Results) -> str:
    """Return the findings of a session, and the planned motion."""
    session = results.session
    stage = session.stage
    html = '<h2>Missing effects</h2>'
    if stage is None:
        html += markup.paragraph('No model yet.', 'quiet')
    elif session.diagnosis is None:
        html += markup.paragraph('No diagnosis yet.' if session.error else
                                 'The diagnosis is running; the views below are ready.', 'quiet')
    elif not session.diagnosis.findings:
        html += markup.paragraph(wording.verdict(session.diagnosis))
    else:
        html += _findings(results)
    if session.plan is not None:
        html += _planned(session.plan)
    if stage is not None and stage.model.applied.effects:
        applied = ', '.join(effect.target for effect in stage.model.applied.effects)
        html += f'<p id="applied">The model includes {markup.text(applied)}.</p>'
    return html


def _findings(results: Results) -> str:
    session = results.session
    is_adding = session.worker.job is not None and session.worker.job.step is Step.ADD
    rows = []
    for number, (finding, targets) in enumerate(results.findings(), start=1):
        buttons = button(f'Add {", ".join(targets)}', 'add', ','.join(targets),
                         disabled=is_adding) if targets else ''
        if finding.effect is not None and finding.verdict in OPEN:
            buttons += button('Plan for this effect', 'plan',
                              effect_name(finding.effect, finding.joint), disabled=is_adding)
        rows.append(f'<div class="finding">{_finding(number, finding)}{buttons}</div>')
    to_add, more = results.to_add(), rows[_AT_FIRST:]
    html = markup.paragraph('Held-out errors are relative to the range of the torque.', 'quiet')
    html += ''.join(rows[:_AT_FIRST])
    if len(to_add) > 1:
        html += button(f'Add all {len(to_add)}', 'add', ','.join(to_add), 'primary', is_adding)
    return html + (markup.folded(f'{len(more)} more …', ''.join(more)) if more else '')


def _finding(number: int, finding: Finding) -> str:
    alternatives = f'; alternative: {", ".join(finding.rivals)}' if finding.rivals else ''
    values = markup.units(f'{wording.coefficients(finding.coefficients, _MAX_COEFFICIENTS)}; '
                          if finding.coefficients else '')
    return (f'<p><b>{number}. {markup.text(finding.effect or "unexplained")}</b> on '
            f'{markup.text(finding.joint or "whole arm")}, {markup.text(finding.verdict)}<br>'
            f'<span class="quiet">{markup.text(values)} held-out error '
            f'{markup.text(wording.change(finding) + alternatives)}</span></p>')


def _planned(plan: MotionPlan) -> str:
    """Return the description, the expected results, and the downloads of a planned motion."""
    start = ', '.join(f'{name} {value:.3f}' for name, value in zip(
        plan.trajectory.joints, plan.trajectory.q[0]))
    return (
        f'<h3 id="planned">Planned: {markup.text(plan.summary())}</h3>'
        + markup.bullets(part.sentence for part in plan.parts)
        + TextTable(EXPECTED, [each.row() for each in plan.expectations]).html()
        + markup.paragraph(f'Move the arm to {start} rad first. Obstacles and people '
                           f'are not checked: keep the space around the arm clear.', 'warning')
        + ''.join(markup.paragraph(note, 'quiet') for note in plan.notes)
        + markup.paragraph('Play it, record it, and add the recording to this page.')
        + download('Save as trajectory (YAML)', 'motion.yaml')
        + download('Save as action goal', 'goal.yaml'))


# Name of a stage, and its errors by joint in N·m.
Errors = Sequence[tuple[str, dict[str, float]]]


def history_html(results: Results) -> str:
    """Return the errors of the stages of a session, undo, and the request of a plan."""
    session, stage, at = results.session, results.session.stage, results.session.at
    errors = [] if at is None or not session.is_read else [
        (stage.name, known) for stage in session.stages[:at + 1][-_MAX_STAGES:]
        if (known := results.errors(stage))]
    html = '<h2>Error history</h2>' + last_change(errors)
    if len(errors) > 1:
        html += markup.folded('all joints and stages', TextTable(
            ('RMSE, N·m', *(name for name, _ in errors)), [
                [joint, *(f'{known[joint]:.4f}' if joint in known else '–' for _, known in errors)]
                for joint in errors[-1][1]]).html())
    if stage is None or at is None:
        return html
    if at > 0:
        html += button(f'Undo {stage.name}', 'stage', str(at - 1))
    html += '<p>' + select('Stage', 'stage', [
        (str(k), f'{k + 1}. {each.name}' + (' (undone)' if k > at else ''))
        for k, each in enumerate(session.stages)], str(at), 'stage') + '</p>'
    if session.diagnosis is not None and stage.model.energy is not None:
        html += button('Plan a motion for all open findings', 'plan',
                       disabled=session.worker.job is not None)
    return html


def last_change(stages: Errors) -> str:
    """Return the last change of the error as HTML."""
    if len(stages) < 2:
        return markup.paragraph('The errors of all stages appear here.', 'quiet')
    (_, before), (name, now) = stages[-2:]
    shared = [joint for joint in now if before.get(joint, 0.0) > 0.0]
    if not shared:
        return ''
    joint = min(shared, key=lambda joint: now[joint] / before[joint])
    return (f'<p>{markup.text(name)}: RMSE of {markup.text(joint)} '
            f'<b class="fall">{before[joint]:.4f} → {now[joint]:.4f} N·m</b> '
            f'({100.0 * (now[joint] / before[joint] - 1.0):+.0f} %)</p>')
