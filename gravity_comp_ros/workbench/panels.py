"""Panels of the page: settings, findings with buttons, planned motion, error history."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from bokeh.layouts import column, row
from bokeh.models import CheckboxGroup, Select, TextInput, UIElement
from gravity_comp_ros.api.axes import NO_DESCRIPTION
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.errors import DataError, GravityCompError, OptionError
from gravity_comp_ros.estimation.estimate import CHOICES
from gravity_comp_ros.facts.fact import refused
from gravity_comp_ros.models.applied_effects import target as effect_name
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import model_text
from gravity_comp_ros.planning.expected import EXPECTED
from gravity_comp_ros.planning.questions import OPEN
from gravity_comp_ros.planning.trajectory_files import to_yaml
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.page import report_html
from gravity_comp_ros.report.style import bar_key, bar_plot, Bars, HEAT
from gravity_comp_ros.report.views.effects import coefficients
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.jobs import Step
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.store import Choice

def request_controls(session: Session) -> list[UIElement]:
    """Return the button that requests a plan for all open findings; none without a diagnosis."""
    if session.diagnosis is None or session.stage is None or session.stage.model.energy is None:
        return []
    return [widgets.button('Plan a motion for all open findings',
                           lambda: session.request_plan(None), name='plan',
                           disabled=session.worker.job is not None)]


def planned(session: Session, browser: widgets.Browser) -> list[UIElement]:
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
        + markup.paragraph(f'Move the arm to {start} rad first. Obstacles and people '
                           f'are not checked: keep the space around the arm clear.', 'warning')
        + ''.join(markup.paragraph(note, 'quiet') for note in plan.notes)
        + markup.paragraph('Play it, record it, and drop the recording into this page.'))
    trajectory = plan.trajectory
    files = [widgets.button(f'Save as {title}', partial(browser.send, 'save', *file), name=name)
             for title, name, *file in (
                 ('trajectory (YAML)', 'plan-yaml', 'motion.yaml', 'application/yaml',
                  to_yaml(trajectory, sentences)),
                 ('action goal', 'plan-goal', 'goal.yaml', 'application/yaml',
                  to_yaml(trajectory, sentences, True)))]
    return [column(widgets.html(text), row(*files, styles={'flex-wrap': 'wrap'}),
                   sizing_mode='stretch_width')]


# Number of findings shown at first, so that the first view fits on the same screen.
_AT_FIRST, _MAX_COEFFICIENTS = 3, 1

Add = Callable[[tuple[str, ...]], None]


def findings(results: Results, add: Add, browser: widgets.Browser) -> list[UIElement]:
    """Return the panel of the findings of a session, and of the planned motion."""
    session = results.session
    stage = session.stage
    elements: list[UIElement] = [widgets.html('<h2>Missing effects</h2>')]
    if stage is None:
        elements.append(_quiet('No model yet.'))
    elif session.diagnosis is None:
        elements.append(_quiet('No diagnosis yet.' if session.error else
                               'The diagnosis is running; the views below are ready.'))
    else:
        elements += _findings(results, add)
        elements += planned(session, browser)
    if stage is not None and stage.model.applied.effects:
        applied = ', '.join(e.target for e in stage.model.applied.effects)
        elements.append(widgets.html(f'<p id="applied">The model includes {markup.text(applied)}.'
                                     '</p>'))
    return elements


def _findings(results: Results, add: Add) -> list[UIElement]:
    findings, diagnosis = results.findings(), results.session.diagnosis
    if not findings and diagnosis is not None:
        return [widgets.html(markup.paragraph(wording.verdict(diagnosis)))]
    job = results.session.worker.job
    adding = job is not None and job.step is Step.ADD
    rows = [_row(number, finding, target, add, adding, results.session)
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
         session: Session) -> UIElement:
    buttons: list[tuple[str, str, Callable[[], None]]] = []
    if target:
        buttons.append((f'Add {target}', f'add-{number}', lambda: add((target,))))
    if finding.effect is not None and finding.verdict in OPEN:
        name = effect_name(finding.effect, finding.joint)
        buttons.append(('Plan for this effect', f'plan-{number}',
                        lambda: session.request_plan((name,))))
    return row(
        widgets.html(_finding_html(number, finding), margin=(1, 5, 1, 5),
                     styles={'flex': '1 1 220px'}),
        *(widgets.button(text, action, disabled=adding, name=name, margin=(2, 5, 2, 5),
                         styles={'flex': '0 1 auto', 'max-width': '210px'})
          for text, name, action in buttons),
        sizing_mode='stretch_width', styles={'flex-wrap': 'wrap'})


def _finding_html(number: int, finding: Finding) -> str:
    alternatives = f'; alternative: {", ".join(finding.rivals)}' if finding.rivals else ''
    values = coefficients(finding, _MAX_COEFFICIENTS)
    return (f'<p class="finding"><b>{number + 1}. {markup.text(finding.effect or "unexplained")}'
            f'</b> on {markup.text(finding.joint or "whole arm")}, '
            f'{markup.text(finding.verdict)}<br>'
            f'<span class="quiet">{markup.text(values)}; held-out error '
            f'{markup.text(wording.change(finding) + alternatives)}</span></p>')


def _quiet(text: str) -> UIElement:
    return widgets.html(markup.paragraph(text, 'quiet'))


# Maximum number of stages in the chart; each compares its model on all samples.
_MAX_STAGES = 8
# Name of a stage, and its errors by joint in N·m.
Errors = Sequence[tuple[str, dict[str, float]]]


def history(results: Results) -> list[UIElement]:
    """Return the panel of the stages of a session: errors, undo."""
    session, stage, at = results.session, results.session.stage, results.session.at
    errors = [] if at is None or not session.is_read else [
        (stage.name, known) for stage in session.stages[:at + 1][-_MAX_STAGES:]
        if (known := results.errors(stage))]
    elements: list[UIElement] = [widgets.html('<h2>Error history</h2>' + last_change(errors))]
    if len(errors) > 1:
        joints = list(errors[-1][1])
        bars = [Bars(name, [known.get(joint, float('nan')) for joint in joints],
                     HEAT[len(HEAT) * (k + 1) // len(errors) - 1])
                for k, (name, known) in enumerate(errors)]
        elements += [widgets.html(bar_key(bars)), bar_plot('RMSE, N·m', joints, bars, '0.0000')]
    if stage is None or at is None:
        return elements
    options = [(str(k), f'{k + 1}. {s.name}' + (' (undone)' if k > at else ''))
               for k, s in enumerate(session.stages)]
    if at > 0:
        elements.append(widgets.button(
            f'Undo {stage.name}', lambda: session.select_stage(at - 1), name='undo'))
    return [*elements, widgets.select('Stage', options, str(at),
                                      lambda value: session.select_stage(int(value)), 'stage')]


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


_SLOW, _ALL = 'slow', 'all'
_KNOWN, _UNKNOWN = 'known', 'unknown'


class Sidebar:
    """Widgets of the settings, and the `Choice` that they show."""

    def __init__(self, results: Results, browser: widgets.Browser) -> None:
        self._results, self._browser, session = results, browser, results.session
        choice, read = session.choice, session.read
        reports = read.reports if read else ()
        facts = [*(read.facts if read else ()), *(fact for r in reports for fact in r.facts)]
        self.shows, self._joints = choice, session.joints
        self.runs: CheckboxGroup = widgets.boxes([r.path.name for r in reports], choice.runs,
                                                 'runs')
        self.joints: CheckboxGroup = widgets.boxes(
            self._joints, [self._joints.index(name) for name in choice.joints], 'joints')
        self.samples: Select = widgets.select(
            'Samples for fit and errors', [(_SLOW, 'slow samples'), (_ALL, 'all samples')],
            _SLOW if choice.gate else _ALL, name='samples')
        self._gate = choice.gate or GateOptions()
        self.limit: TextInput = widgets.field(
            'Speed limit of slow samples, rad/s', f'{self._gate.max_speed:g}', 'max-speed')
        self.scales: dict[str, TextInput] = {
            name: widgets.field(name, f'{choice.reading.effort_scale.get(name, 1.0):g}',
                                f'scale-{k}')
            for k, name in enumerate(self._joints)}
        self.speeds = widgets.boxes(['compute velocities from positions'],
                                    [0] if choice.reading.differentiate else [], 'differentiate')
        self.formulation: Select = widgets.select('Formulation', [(c, c) for c in CHOICES],
                                                  choice.formulation, name='formulation')
        # Kinds of facts that are refused, or were accepted.
        kinds = dict.fromkeys(fact.kind.value for fact in refused(facts))
        self._kinds = tuple(dict.fromkeys((*choice.reading.accept, *kinds)))
        self.accept: CheckboxGroup = widgets.boxes(
            [f'accept {kind}' for kind in self._kinds],
            [self._kinds.index(kind) for kind in choice.reading.accept], 'accept')
        known = [(_KNOWN, 'from the description, if any'), (_UNKNOWN, 'unknown')]
        self._urdf = choice.urdf if choice.urdf != NO_DESCRIPTION else \
            None if session.urdf is None else str(session.urdf)
        self.axes: Select = widgets.select(
            'Axes of the arm', known, _UNKNOWN if choice.urdf == NO_DESCRIPTION else _KNOWN,
            name='axes')
        self.element = column(*self._parts(), sizing_mode='stretch_width')

    def choice(self) -> Choice:
        """
        Return the choice of the widgets.

        :raises OptionError: if a value is invalid.
        """
        runs = tuple(sorted(self.runs.active))
        joints = tuple(self._joints[k] for k in sorted(self.joints.active))
        if not runs or not joints:
            raise OptionError('select at least one run and one joint')
        scale = {name: _number(field.value, f'the scale of the effort of {name}')
                 for name, field in self.scales.items()}
        reading = replace(
            self.shows.reading, effort_scale={name: x for name, x in scale.items() if x != 1.0},
            differentiate=bool(self.speeds.active),
            accept=tuple(self._kinds[k] for k in sorted(self.accept.active)))
        gate = None if self.samples.value == _ALL else replace(
            self._gate, max_speed=_number(self.limit.value, 'the speed limit'))
        return Choice(runs, joints, self.formulation.value, reading, gate,
                      NO_DESCRIPTION if self.axes.value == _UNKNOWN else self._urdf)

    def _apply(self, action: Callable[[Choice], None]) -> None:
        """Call a request of the session with the choice, or show why it is invalid."""
        try:
            action(self.choice())
        except GravityCompError as problem:
            self._results.session.warn(str(problem))

    def _save(self, name: str, kind: str, make: Callable[[GravityModel], str]) -> None:
        """Download a file made of the current model."""
        session = self._results.session
        try:
            if session.stage is None:
                raise DataError('there is no model yet')
            self._browser.send('save', name, kind, make(session.stage.model))
        except GravityCompError as problem:
            session.warn(str(problem))

    def _parts(self) -> list[UIElement]:
        results, session = self._results, self._results.session
        units = column(widgets.html('<p class="quiet">N·m per unit of effort, e.g. a torque '
                                    'constant; −1 inverts the sign</p>'),
                       *self.scales.values(), self.speeds, sizing_mode='stretch_width',
                       name='units', visible=any(f.value != '1' for f in self.scales.values())
                       or bool(self.speeds.active))
        show_units = widgets.button('Units and velocities …', lambda: widgets.toggle(units),
                                    name='show-units')
        return [
            widgets.html('<h3>Runs</h3>'), self.runs, self.accept, widgets.html('<h3>Joints</h3>'),
            self.joints, widgets.html('<h3>Samples</h3>'), self.samples, self.limit, show_units,
            units, self.formulation, self.axes,
            widgets.button('Fit with these settings', lambda: self._apply(session.learn),
                           'primary', name='learn'),
            widgets.button('Evaluate the current model on these',
                           lambda: self._apply(session.evaluate), name='evaluate'),
            widgets.html('<h3>Export</h3>'),
            widgets.button('Save the model', lambda: self._save(
                'arm.json', 'application/json', model_text), name='export-model'),
            widgets.button('Save a report', lambda: self._save(
                'report.html', 'text/html', lambda model: report_html(results.contents())),
                name='export-report'),
            widgets.button('Save command lines', lambda: self._save(
                'workbench.sh', 'text/x-shellscript', lambda model: '\n'.join(
                    ['#!/bin/sh', 'set -e', *session.commands(), ''])), name='export-commands')]


def _number(text: str, what: str) -> float:
    try:
        return float(text.replace('−', '-').replace(',', '.'))
    except ValueError:
        raise OptionError(f'{what} is {text!r}, not a number') from None
