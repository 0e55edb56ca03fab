"""Side bar of the page: runs, joints, samples, units, formulation, and export buttons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bokeh.layouts import column
from bokeh.models import CheckboxGroup, Select, TextInput, UIElement
from gravity_comp_ros.api.axes import NO_DESCRIPTION
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import DataError, GravityCompError, OptionError
from gravity_comp_ros.estimation.estimate import CHOICES
from gravity_comp_ros.facts.fact import refused
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.report.page import report_html
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.store import Choice, model_text

_SLOW, _ALL = 'slow', 'all'
_KNOWN, _UNKNOWN = 'known', 'unknown'


class Sidebar:
    """Widgets of the settings, and the `Choice` that they show."""

    def __init__(self, results: Results, browser: widgets.Browser) -> None:
        self._results, self._browser, session = results, browser, results.session
        choice, read = session.choice, session.read
        reports = read.reports if read else ()
        self.shows, self._joints = choice, session.joints
        self.runs: CheckboxGroup = widgets.boxes([r.path.name for r in reports], choice.runs,
                                                 'runs')
        self.joints: CheckboxGroup = widgets.boxes(
            self._joints, [self._joints.index(name) for name in choice.joints], 'joints')
        self.samples: Select = widgets.select(
            'Samples for fit and errors', [(_SLOW, 'slow samples'), (_ALL, 'all samples')],
            _ALL if choice.all_samples else _SLOW, name='samples')
        limit = '' if choice.max_speed is None else f'{choice.max_speed:g}'
        self.limit: TextInput = widgets.field(
            'Speed limit of slow samples, rad/s', limit, 'max-speed',
            f'{GateOptions().max_speed:g}')
        self.scales: dict[str, TextInput] = {
            name: widgets.field(name, f'{choice.reading.effort_scale.get(name, 1.0):g}',
                                f'scale-{k}')
            for k, name in enumerate(self._joints)}
        self.speeds = widgets.boxes(['compute velocities from positions'],
                                    [0] if choice.reading.differentiate else [], 'differentiate')
        self.formulation: Select = widgets.select('Formulation', [(c, c) for c in CHOICES],
                                                  choice.formulation, name='formulation')
        # Kinds of facts that are refused, or were accepted.
        kinds = dict.fromkeys(fact.kind.value for r in reports for fact in refused(r.facts))
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
        limit = self.limit.value.strip()
        reading = replace(
            self.shows.reading, effort_scale={name: x for name, x in scale.items() if x != 1.0},
            differentiate=bool(self.speeds.active),
            accept=tuple(self._kinds[k] for k in sorted(self.accept.active)))
        return Choice(runs, joints, self.formulation.value, reading,
                      _number(limit, 'the speed limit') if limit else None,
                      self.samples.value == _ALL,
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
