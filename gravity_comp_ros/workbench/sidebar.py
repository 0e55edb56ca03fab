"""Side bar of the page: runs, joints, samples, units, formulation, and export buttons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from bokeh.layouts import column
from bokeh.models import CheckboxGroup, Select, TextInput, UIElement
from gravity_comp_ros.api.axes import NO_DESCRIPTION
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import CHOICES
from gravity_comp_ros.facts.fact import refused
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.stages import Choice

_SLOW, _ALL = 'slow', 'all'
_KNOWN, _UNKNOWN = 'known', 'unknown'


@dataclass(frozen=True)
class Actions:
    """Actions of the buttons of the side bar."""

    learn: Callable[[], None]
    evaluate: Callable[[], None]
    save_model: Callable[[], None]
    save_report: Callable[[], None]
    save_commands: Callable[[], None]


class Sidebar:
    """Widgets of the settings, and the `Choice` that they show."""

    def __init__(self, session: Session, actions: Actions) -> None:
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
        self.element = column(*self._parts(actions), sizing_mode='stretch_width')

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

    def _parts(self, actions: Actions) -> list[UIElement]:
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
            widgets.button('Fit with these settings', actions.learn, 'primary', name='learn'),
            widgets.button('Evaluate the current model on these', actions.evaluate,
                           name='evaluate'),
            widgets.html('<h3>Export</h3>'),
            widgets.button('Save the model', actions.save_model, name='export-model'),
            widgets.button('Save a report', actions.save_report, name='export-report'),
            widgets.button('Save command lines', actions.save_commands, name='export-commands')]


def _number(text: str, what: str) -> float:
    try:
        return float(text.replace('−', '-').replace(',', '.'))
    except ValueError:
        raise OptionError(f'{what} is {text!r}, not a number') from None
