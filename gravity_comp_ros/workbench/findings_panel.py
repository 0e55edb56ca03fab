"""Panel of the findings, with buttons to add effects and plan motions."""

from __future__ import annotations

from collections.abc import Callable

from bokeh.layouts import column, row
from bokeh.models import UIElement
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.models.applied_effects import target as effect_name
from gravity_comp_ros.planning.questions import OPEN
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.views.effects import coefficients, label
from gravity_comp_ros.workbench import plan_panel, widgets
from gravity_comp_ros.workbench.jobs import Add as AddJob
from gravity_comp_ros.workbench.plan_panel import PlanActions
from gravity_comp_ros.workbench.results import Results

# Number of findings shown at first, so that the first view fits on the same screen.
_AT_FIRST, _MAX_COEFFICIENTS = 3, 1

Add = Callable[[tuple[str, ...]], None]


def parts(results: Results, add: Add, plans: PlanActions) -> list[UIElement]:
    """Return the panel of a session."""
    session = results.session
    stage = session.stage
    elements: list[UIElement] = [widgets.html('<h2>Missing effects</h2>')]
    if stage is None:
        elements.append(_quiet('No model yet.'))
    elif session.diagnosis is None:
        elements.append(_quiet('No diagnosis yet.' if session.error else
                               'The diagnosis is running; the views below are ready.'))
    else:
        elements += _findings(results, add, plans)
        elements += plan_panel.planned(session, plans)
    if stage is not None and stage.model.applied.effects:
        applied = ', '.join(e.target for e in stage.model.applied.effects)
        elements.append(widgets.html(f'<p id="applied">The model includes {markup.text(applied)}.'
                                     '</p>'))
    return elements


def _findings(results: Results, add: Add, plans: PlanActions) -> list[UIElement]:
    findings, diagnosis = results.findings(), results.session.diagnosis
    if not findings and diagnosis is not None:
        return [widgets.html(markup.paragraph(wording.verdict(diagnosis)))]
    adding = isinstance(results.session.worker.job, AddJob)
    rows = [_row(number, finding, target, add, adding, plans)
            for number, (finding, target) in enumerate(findings)]
    elements = [widgets.html('<p class="finding quiet">Held-out errors are relative to the range '
                             'of the torque.</p>'), *rows[:_AT_FIRST]]
    below: list[UIElement] = []
    to_add = results.to_add()
    if len(to_add) > 1:
        below.append(widgets.button(f'Add all {len(to_add)}',
                                    lambda: add(to_add), 'primary', disabled=adding,
                                    name='add-all'))
    rest = column(*rows[_AT_FIRST:], sizing_mode='stretch_width', visible=False)
    if len(rows) > _AT_FIRST:
        below.append(widgets.button(f'{len(rows) - _AT_FIRST} more …',
                                    lambda: widgets.toggle(rest), name='more'))
    return [*elements, row(*below, styles={'flex-wrap': 'wrap'}), rest] if below else elements


def _row(number: int, finding: Finding, target: str, add: Add, adding: bool,
         plans: PlanActions) -> UIElement:
    entry: list[UIElement] = [widgets.html(_finding_html(number, finding), margin=(1, 5, 1, 5),
                                           styles={'flex': '1 1 220px'})]
    if target:
        entry.append(widgets.button(f'Add {target}', lambda: add((target,)),
                                    disabled=adding, name=f'add-{number}', margin=(2, 5, 2, 5),
                                    styles={'flex': '0 1 auto', 'max-width': '210px'}))
    if finding.effect is not None and finding.verdict in OPEN:
        name = effect_name(finding.effect, finding.joint)
        entry.append(widgets.button('Plan for this effect', lambda: plans.plan((name,)),
                                    disabled=adding, name=f'plan-{number}', margin=(2, 5, 2, 5),
                                    styles={'flex': '0 1 auto', 'max-width': '210px'}))
    return row(*entry, sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'})


def _finding_html(number: int, finding: Finding) -> str:
    alternatives = f'; alternative: {", ".join(finding.rivals)}' if finding.rivals else ''
    values = coefficients(finding, _MAX_COEFFICIENTS)
    return (f'<p class="finding"><b>{number + 1}. {markup.text(label(finding))}</b> on '
            f'{markup.text(finding.joint or "whole arm")}, {markup.text(finding.verdict)}<br>'
            f'<span class="quiet">{markup.text(values)}; held-out error '
            f'{markup.text(wording.change(finding) + alternatives)}</span></p>')


def _quiet(text: str) -> UIElement:
    return widgets.html(markup.paragraph(text, 'quiet'))
