"""
The one table of the node's parameters.

It makes the descriptors, the checks on set, and docs/parameters.md:
`python3 -m gravity_comp_ros.node.parameters > docs/parameters.md`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import math
from typing import cast

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node.payload import PayloadLimits

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

NUMBERS = ('int', 'double', 'double[]')
ARRAYS = ('double[]', 'string[]')


@dataclass(frozen=True)
class Parameter:
    """
    One row of the table.

    `kind` is bool, int, double, string, double[] or string[]. `low` and `high` bound every
    number, both included; `choices` lists the strings that are allowed, if it is not empty.
    """

    name: str
    kind: str
    default: Value
    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False

    def parse(self, value: object) -> Value:
        """
        Return `value` in the parameter's own type; a whole number may stand for a double.

        :raises OptionError: if the type is wrong, or a value is out of range, not finite or
            not among the choices; the message says what is allowed.
        """
        if self.kind in ARRAYS:
            if value is None:
                # What an empty list in YAML, or after -p on a command line, arrives as.
                return ()
            if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
                raise self._wrong(value, f'it must be a list of type {self.kind}')
            items = tuple(self._item(item, self.kind[:-2]) for item in value)
            if self.kind == 'string[]' and len(set(items)) != len(items):
                raise self._wrong(value, 'its entries must differ')
            return items  # type: ignore[return-value]
        return self._item(value, self.kind)

    def _item(self, value: object, kind: str) -> bool | int | float | str:
        if kind == 'bool':
            if not isinstance(value, bool):
                raise self._wrong(value, 'it must be true or false')
            return value
        if kind == 'string':
            return self._text(value)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self._wrong(value, f'it must be of type {self.kind}')
        if kind == 'int' and not isinstance(value, int):
            raise self._wrong(value, 'it must be a whole number')
        if not math.isfinite(value):
            raise self._wrong(value, 'it must be finite')
        if (self.low is not None and value < self.low) or (
                self.high is not None and value > self.high):
            raise self._wrong(value, f'it must lie in {self.range_text()}')
        return value if kind == 'int' else float(value)

    def _text(self, value: object) -> str:
        if not isinstance(value, str):
            raise self._wrong(value, 'it must be text')
        if self.choices and value not in self.choices:
            raise self._wrong(repr(value), f'it must be one of {", ".join(self.choices)}')
        return value

    def _wrong(self, value: object, what: str) -> OptionError:
        shown = list(value) if isinstance(value, tuple) else value
        unit = f' {self.unit}' if self.unit and self.kind in NUMBERS else ''
        return OptionError(f'parameter {self.name}: {shown}{unit} is refused; {what}')

    def range_text(self) -> str:
        """Return what is allowed, for people."""
        if self.choices:
            return ', '.join(self.choices)
        if self.low is None and self.high is None:
            return ''
        low = '' if self.low is None else f'{self.low:g}'
        high = '' if self.high is None else f'{self.high:g}'
        return f'{low} to {high}'.strip()


TABLE: tuple[Parameter, ...] = (
    Parameter(
        'autostart', 'bool', True,
        'Configure and activate without being told to. Set it to false where a lifecycle '
        'manager does that.', read_only=True),
    Parameter(
        'diagnostics_rate', 'double', 1.0, 'How often /diagnostics is published.', 'Hz', 0.1,
        20.0, read_only=True),
    Parameter(
        'joints', 'string[]', (),
        'Joint names, in the order of the torques on `~/commands`. If the list is empty, the '
        'names of the model file are taken, and without one those of the first `joint_states` '
        'message: set it where grippers or several arms share the topic.', read_only=True),
    Parameter(
        'effort_scale', 'double[]', (),
        'Torque per unit of the effort field, sign included: the torque constant where effort '
        'is a motor current, -1 where it counts the other way. One value for all joints or one '
        'per joint; empty means 1.', 'N·m per unit', -1e6, 1e6, read_only=True),
    Parameter(
        'robot_description', 'string', 'auto',
        'Where the axes of the arm, its joints without end and its effort limits are taken from: '
        '`auto` listens to the topic `robot_description`, `off` does not, anything else is the '
        'text of a URDF.', read_only=True),
    Parameter(
        'continuous_joints', 'string[]', (),
        'Joints that may turn without end. Any other joint further than 4π from 0 is refused as a '
        'pose: angles in degrees are such. Torque has a period of one turn for every joint.',
        read_only=True),
    Parameter(
        'max_speed', 'double', 0.15,
        'Samples are learned from while no joint is faster than this.', 'rad/s', 0.001, 10.0),
    Parameter(
        'max_acceleration', 'double', 0.0,
        'Samples are learned from while no joint accelerates more than this, as a mean over '
        '0.1 s; 0 does not judge it.', 'rad/s²', 0.0, 1000.0),
    Parameter(
        'sample_rate', 'double', 5.0,
        'At most so many samples are taken per second.', 'Hz', 0.1, 1000.0),
    Parameter(
        'capacity', 'int', 1500,
        'Samples kept; once they are there, new poses replace those that have a close '
        'neighbour.', 'samples', 50, 20000, read_only=True),
    Parameter(
        'auto_fit', 'bool', True,
        'In an open epoch, fit by itself as samples come. If false, only `~/refit` fits.'),
    Parameter(
        'formulation', 'string', 'auto',
        'The model: one sparse energy for all joints (`potential`); the same with the structure '
        'of a serial arm (`chain`); whichever of the two predicts held-out samples better '
        '(`auto`); or a separate sum per joint as in the paper.',
        choices=('auto', 'potential', 'chain', 'per_joint')),
    Parameter(
        'effects', 'string[]', (),
        'Effects that fits of a whole model tell apart from gravity, `NAME` or `NAME:JOINT`; '
        'call `~/refit` after a change. The feed-forward stays gravity alone, but for those in '
        '`compensate`.'),
    Parameter(
        'compensate', 'string[]', (),
        'Effects of the model, `NAME` or `NAME:JOINT`, whose torque is sent as well: '
        '`coulomb_friction`, `viscous_friction`, `stribeck_friction`, '
        '`load_dependent_friction`, `torque_offset`, `joint_spring` or `cable_stiffness`. Those '
        'that the model does not have count for nothing, and diagnostics say so.'),
    Parameter(
        'compensate_fraction', 'double', 0.7,
        'How much of it is sent. All of a friction makes an arm slide by itself.', '', 0.0, 1.0),
    Parameter(
        'compensate_speed', 'double', 0.02,
        'Friction that is compensated turns its sign over this speed at least: above the noise '
        'of the velocity at rest.', 'rad/s', 0.001, 1.0),
    Parameter(
        'settle_time', 'double', 0.5,
        'For this long after `~/payload_changed` nothing is learned: messages from before the '
        'call are still under way, and the payload still swings.', 's', 0.0, 60.0),
    Parameter(
        'min_samples', 'int', 30,
        'With a model whose change can be fitted, the first fit of an epoch waits for so many '
        'samples to learn from.', 'samples', 10, 10000),
    Parameter(
        'first_samples', 'int', 100,
        'Without such a model it waits for so many: fewer fit well and predict badly.',
        'samples', 10, 10000),
    Parameter(
        'full_samples', 'int', 500,
        'The epoch closes with a fit of this many samples, once every joint has its range.',
        'samples', 20, 20000),
    Parameter(
        'min_span', 'double', 0.2,
        'A joint that moved over less than this in an epoch is reported as lacking range.',
        'rad', 0.0, 6.3),
    Parameter(
        'max_payload', 'double', 20.0,
        'The heaviest body that is put on the last link or taken off. A change of the torque that '
        'takes more is refused.', 'kg', 0.01, 1000.0),
    Parameter(
        'max_payload_reach', 'double', 1.0,
        'How far the centre of a payload may be from the last joint; without known axes also the '
        'longest distance of two neighbouring joints.', 'm', 0.01, 10.0),
    Parameter(
        'on_suspected_payload', 'string', 'report',
        'What to do where the residual shows a payload that the node was not told of: `report` '
        'publishes an event on `~/payload_suspected`, `learn` does that and then what '
        '`~/payload_changed` does.', choices=('report', 'learn')),
    Parameter(
        'fit_timeout', 'double', 120.0,
        'A fit that takes longer is taken for hanging: its process is killed and replaced.',
        's', 0.1, 3600.0),
    Parameter(
        'refit_timeout', 'double', 60.0,
        '`~/refit` answers after this time even if the fit still runs.', 's', 0.1, 3600.0),
    Parameter(
        'model_file', 'string', '',
        'Loaded on configuring if it exists, written by `~/save_model`.', read_only=True),
    Parameter(
        'auto_save', 'bool', False,
        'Write the model file whenever a new model is taken into use.'),
    Parameter(
        'history', 'int', 10,
        'Earlier payloads whose last model `~/rollback` can bring back.', 'payloads', 1, 100,
        read_only=True),
    Parameter(
        'enabled', 'bool', True,
        'Publish torques from the start; `~/enable` changes it while the node runs.',
        read_only=True),
    Parameter(
        'ramp_time', 'double', 1.0,
        'Time over which torque goes from none to that of the model, or from the old model to '
        'the new one.', 's', 0.0, 60.0),
    Parameter(
        'max_torque', 'double[]', (),
        'Largest torque that is published: one value for all joints or one per joint. If it is '
        'empty, the effort limits of the robot description count; without those nothing is '
        'published, unless `unlimited_torque` is set.', 'N·m', 0.0, 100000.0),
    Parameter(
        'unlimited_torque', 'bool', False,
        'Publish torque although no bound is known.'),
    Parameter(
        'max_torque_rate', 'double[]', (500.0,),
        'Fastest change of a published torque: one value for all joints or one per joint. '
        'Empty sets no bound.', 'N·m/s', 0.001, 1e6),
    Parameter(
        'extrapolation', 'string', 'hold',
        'What to do with poses further than `extrapolation_margin` outside the trained range: '
        '`hold` computes the torque of the nearest pose inside the margin, `fade` lets torque '
        'fall to zero over a second margin, `trust` uses the model as it is.',
        choices=('hold', 'fade', 'trust')),
    Parameter(
        'extrapolation_margin', 'double', 1.0,
        'Distance outside the trained range up to which the model is used as it is; at most '
        '0.1 rad for a `per_joint` model, which is wrong by far out there.', 'rad', 0.01, 10.0),
    Parameter(
        'stale_after', 'double', 0.3,
        'Without a usable joint state for this long, input counts as stale. Above the period '
        'of `joint_states`.', 's', 0.005, 10.0),
    Parameter(
        'stale_action', 'string', 'fade',
        'On stale input the last torque is held for `hold_time`; then it is either faded to '
        'zero or held for ever.', choices=('fade', 'hold')),
    Parameter(
        'hold_time', 'double', 0.5,
        'How long the last torque is held once input is stale.', 's', 0.0, 3600.0),
    Parameter(
        'fade_time', 'double', 2.0,
        'How long the fall to zero torque then takes. Zero torque drops an arm that has no '
        'brakes.', 's', 0.0, 3600.0),
)

BY_NAME: Mapping[str, Parameter] = {row.name: row for row in TABLE}


def defaults() -> dict[str, Value]:
    """Return the default of every parameter."""
    return {row.name: row.default for row in TABLE}


def check_together(values: Mapping[str, Value], names: tuple[str, ...] = ()) -> None:
    """
    Check what no single parameter shows.

    :param values: all parameters.
    :param names: the joints of the arm where they are known.
    :raises OptionError: if two of them contradict each other.
    """
    joints = values['joints']
    known = cast(tuple[str, ...], joints) or names
    n = len(known)
    for name in ('effort_scale', 'max_torque', 'max_torque_rate'):
        items = values[name]
        if n and isinstance(items, tuple) and len(items) not in (0, 1, n):
            raise OptionError(f'parameter {name}: {len(items)} values for {n} joints '
                              f'({", ".join(known)}); give one for all or one per joint')
    if isinstance(joints, tuple) and len(joints) > 10:
        raise OptionError(f'parameter joints: {len(joints)} joints; a model takes at most 10')
    if 0.0 in (values['effort_scale'] or ()):  # type: ignore[operator]
        raise OptionError('parameter effort_scale: 0 would erase the effort of a joint; leave '
                          'the joint out of `joints`')
    for name in ('min_samples', 'first_samples'):
        if values[name] > values['full_samples']:  # type: ignore[operator]
            raise OptionError(f'parameter {name}: {values[name]} is more than full_samples, '
                              f'{values["full_samples"]}')
    if values['full_samples'] > values['capacity']:  # type: ignore[operator]
        raise OptionError(f'parameter full_samples: {values["full_samples"]} is more than '
                          f'capacity, {values["capacity"]}')


def payload_limits(values: Mapping[str, Value]) -> PayloadLimits:
    """Return what a payload can be from the parameters."""
    return PayloadLimits(cast(float, values['max_payload']),
                         cast(float, values['max_payload_reach']))


def markdown() -> str:
    """Return docs/parameters.md."""
    lines = [
        '# Parameters of the node', '',
        'Made from the table in `gravity_comp_ros/node/parameters.py` by '
        '`python3 -m gravity_comp_ros.node.parameters > docs/parameters.md`.', '',
        'A value that is out of range or of the wrong type is refused with the reason, at the '
        'start as well as by `ros2 param set`. Parameters marked *at start* cannot be changed '
        'while the node runs; all others take effect at once.', '',
        '| parameter | type | default | range | unit | | meaning |',
        '|---|---|---|---|---|---|---|']
    for row in TABLE:
        lines.append(
            f'| `{row.name}` | {row.kind} | {_shown(row.default)} | {row.range_text()} | '
            f'{row.unit} | {"*at start*" if row.read_only else ""} | {row.description} |')
    return '\n'.join(lines) + '\n'


def _shown(value: Value) -> str:
    if isinstance(value, tuple):
        return '`[' + ', '.join(str(item) for item in value) + ']`'
    if isinstance(value, bool):
        return f'`{str(value).lower()}`'
    return f'`{value}`' if value != '' else '(empty)'


if __name__ == '__main__':
    print(markdown(), end='')
