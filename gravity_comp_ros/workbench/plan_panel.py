"""Panel for a planned motion: request, description, and downloads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bokeh.layouts import column, row
from bokeh.models import UIElement
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.planning.expected import EXPECTED
from gravity_comp_ros.planning.questions import OPEN
from gravity_comp_ros.recordings.trajectory_files import to_csv, to_yaml
from gravity_comp_ros.report import markup
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.session import Session

_ALL = ''


@dataclass(frozen=True)
class PlanActions:
    """Actions of the buttons: plan for these effects (None: all open ones), download a file."""

    plan: Callable[[tuple[str, ...] | None], None]
    give: Callable[[str, str, str], None]


def request_controls(session: Session, actions: PlanActions) -> list[UIElement]:
    """Return the controls to request a plan; none without a diagnosis."""
    diagnosis, stage = session.diagnosis, session.stage
    if diagnosis is None or stage is None or stage.model.energy is None:
        return []
    chosen = widgets.select(
        'Next recording resolves', [(_ALL, 'all open findings'), *(
            (name, name) for name in open_effects(diagnosis))], _ALL, name='to-resolve')
    ask = widgets.button('Plan a motion', lambda: actions.plan(
        (str(chosen.value),) if chosen.value else None), name='plan',
                         disabled=session.worker.job is not None)
    chosen.styles = {'flex': '1 1 150px', 'width': 'auto'}
    return [row(chosen, ask, sizing_mode='stretch_width',
                styles={'flex-wrap': 'wrap', 'align-items': 'end'})]


def open_effects(diagnosis: Diagnosis) -> list[str]:
    """Return the open and untestable effects, findings first, as `NAME:JOINT`."""
    effects = [target(f.effect, f.joint) for f in diagnosis.findings
               if f.effect is not None and f.verdict in OPEN]
    effects += [target(effect, joint) for joint, report in diagnosis.joints.items()
                for effect in report.untestable]
    return list(dict.fromkeys(effects))


def planned(session: Session, actions: PlanActions) -> list[UIElement]:
    """Return the description, the expected results, and the downloads of a planned motion."""
    plan = session.plan
    if plan is None:
        return []
    start = ', '.join(f'{name} {value:.3f}' for name, value in zip(
        plan.trajectory.joints, plan.trajectory.q[0]))
    sentences = [part.sentence for part in plan.parts]
    text = (
        f'<h3 id="planned">Planned: {markup.text(plan.summary())}</h3>{markup.bullets(sentences)}'
        + markup.table(EXPECTED, [each.row() for each in plan.expectations], EXPECTED[3:])
        + markup.paragraph(f'Move the arm to {start} rad first. Obstacles, people and '
                           f'self-collisions are not checked: keep the space around the arm '
                           f'clear.', 'warning')
        + ''.join(markup.paragraph(note, 'quiet') for note in plan.notes)
        + markup.paragraph('Play it, record it, and drop the recording into this page.'))
    files = row(
        widgets.button('Save as trajectory (YAML)', lambda: actions.give(
            'motion.yaml', 'application/yaml', to_yaml(plan.trajectory, sentences)),
            name='plan-yaml'),
        widgets.button('Save as action goal', lambda: actions.give(
            'goal.yaml', 'application/yaml', to_yaml(plan.trajectory, sentences, True)),
            name='plan-goal'),
        widgets.button('Save as CSV', lambda: actions.give(
            'motion.csv', 'text/csv', to_csv(plan.trajectory)), name='plan-csv'),
        styles={'flex-wrap': 'wrap'})
    return [column(widgets.html(text), files, sizing_mode='stretch_width')]
