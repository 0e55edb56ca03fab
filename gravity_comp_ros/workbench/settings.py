"""Form of the settings of a session, and the choice that it describes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.facts.fact import refused
from gravity_comp_ros.models.gravity_model import CHOICES
from gravity_comp_ros.report import markup
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.stages import Choice
from gravity_comp_ros.workbench.widgets import box, button, download, field, select

_ALL, _UNKNOWN = 'all', 'unknown'


def form_html(session: Session) -> str:
    """Return the form of the choice of a session that has read its recordings."""
    choice, reports = session.choice, session.read.reports if session.read else ()
    facts = [*(session.read.facts if session.read else ()),
             *(fact for report in reports for fact in report.facts)]
    # Kinds of facts that are refused, or were accepted.
    kinds = dict.fromkeys([*choice.reading.accept, *(f.kind for f in refused(facts))])
    scales = [choice.reading.effort_scale.get(name, 1.0) for name in session.joints]
    is_changed = choice.reading.differentiate or any(scale != 1.0 for scale in scales)
    units = ''.join([
        markup.paragraph('N·m per unit of effort, e.g. a torque constant; −1 inverts the sign',
                         'quiet'),
        *(field(name, f'scale-{k}', f'{scale:g}')
          for k, (name, scale) in enumerate(zip(session.joints, scales))),
        box('compute velocities from positions', 'differentiate', 'yes',
            choice.reading.differentiate)])
    return ''.join([
        '<h3>Runs</h3>', *(box(report.path.name, 'run', str(k), k in choice.runs)
                           for k, report in enumerate(reports)),
        field('Path of another recording', 'recording', ''), button('Add it', 'record'),
        *(box(f'accept {kind}', 'accept', kind, kind in choice.reading.accept) for kind in kinds),
        '<h3>Joints</h3>', *(box(name, 'joint', name, name in choice.joints)
                             for name in session.joints),
        '<h3>Samples</h3>',
        select('Samples for fit and errors', 'samples', [
            ('slow', 'slow samples'), (_ALL, 'all samples')], 'slow' if choice.gate else _ALL),
        field('Speed limit of slow samples, rad/s', 'max-speed',
              f'{(choice.gate or GateOptions()).max_speed:g}'),
        f'<details{" open" * is_changed}><summary>Units and velocities …</summary>{units}'
        '</details>',
        select('Formulation', 'formulation', [(name, name) for name in CHOICES],
               choice.formulation),
        select('Axes of the arm', 'axes', [('known', 'from the description, if any'),
                                           (_UNKNOWN, 'unknown')],
               'known' if choice.known_axes else _UNKNOWN),
        button('Fit with these settings', 'learn', kind='primary'),
        button('Evaluate the current model on these', 'evaluate'),
        '<h3>Export</h3>', download('Save the model', 'arm.json'),
        download('Save a report', 'report.html'),
        download('Save command lines', 'workbench.sh')])


def choice_of(session: Session, form: Mapping[str, Sequence[str]]) -> Choice:
    """
    Return the choice that a form describes.

    :param form: values by name.
    :raises OptionError: if a value is invalid.
    """
    n_runs = len(session.read.reports) if session.read else 0
    runs = tuple(k for k in range(n_runs) if str(k) in form.get('run', ()))
    joints = tuple(name for name in session.joints if name in form.get('joint', ()))
    if not runs or not joints:
        raise OptionError('select at least one run and one joint')
    scale = {name: _number(form[f'scale-{k}'][0], f'the scale of the effort of {name}')
             for k, name in enumerate(session.joints)}
    accept = tuple(form.get('accept', ()))
    reading = replace(session.choice.reading, accept=accept,
                      effort_scale={name: x for name, x in scale.items() if x != 1.0},
                      differentiate='differentiate' in form)
    gate = None if form['samples'][0] == _ALL else replace(
        session.choice.gate or GateOptions(),
        max_speed=_number(form['max-speed'][0], 'the speed limit'))
    return Choice(runs, joints, form['formulation'][0], reading, gate, session.choice.urdf,
                  form['axes'][0] != _UNKNOWN)


def _number(text: str, what: str) -> float:
    try:
        return float(text.replace('−', '-').replace(',', '.'))
    except ValueError:
        raise OptionError(f'{what} is {text!r}, not a number') from None
