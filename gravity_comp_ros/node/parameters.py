"""
Table of the node's parameters: types, ranges, descriptions, and the check of a value.

docs/parameters.md is generated from it: `python3 docs/make_parameters.py > docs/parameters.md`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
import math
from typing import Any

from gravity_comp_ros.effects.registry import requests
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.facts.fact import Kind

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

# ROS type by the annotation of a field, and the Python types of an item by the ROS type.
_KINDS = {'bool': 'bool', 'int': 'int', 'float': 'double', 'str': 'string',
          'tuple[float, ...]': 'double[]', 'tuple[str, ...]': 'string[]'}
_TYPES: dict[str, Any] = {'bool': bool, 'int': int, 'double': (int, float), 'string': str}


@dataclass(frozen=True)
class Parameter:
    """
    One row of the table of parameters.

    `kind` is the ROS type. `low` and `high` bound each number, both included; `choices` lists the
    allowed strings, empty for any. With `may_be_off` the value `off` is allowed, which YAML reads
    as false.
    """

    name: str
    kind: str
    default: Value
    description: str
    unit: str = ''
    low: float = 0.0
    high: float = 0.0
    choices: tuple[str, ...] = ()
    read_only: bool = False
    may_be_off: bool = False

    def parse(self, value: object) -> Value:
        """
        Return `value` in the type of the parameter; integers are accepted for a double.

        :raises OptionError: if the type is wrong, or a value is out of range, not finite or
            not among the choices; the message gives the allowed values.
        """
        if not self.kind.endswith('[]'):
            return self._item(value)
        if value is None:
            # An empty list in YAML or after -p on a command line.
            return ()
        if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
            raise self._wrong(value, f'it must be of type {self.kind}')
        items = tuple(self._item(item) for item in value)
        if self.kind == 'string[]' and len(set(items)) != len(items):
            raise self._wrong(value, 'its entries must differ')
        return items  # type: ignore[return-value]

    def _item(self, value: Any) -> Any:
        if value is False and self.may_be_off:
            return 'off'
        kind = self.kind.removesuffix('[]')
        if not isinstance(value, _TYPES[kind]) or isinstance(value, bool) != (kind == 'bool'):
            raise self._wrong(value, f'it must be of type {self.kind}')
        if self.choices and value not in self.choices:
            raise self._wrong(repr(value), f'it must be one of {self.range_text()}')
        if isinstance(value, (bool, str)):
            return value
        if not math.isfinite(value):
            raise self._wrong(value, 'it must be finite')
        if not self.low <= value <= self.high:
            raise self._wrong(value, f'it must lie in {self.range_text()}')
        return value if self.kind == 'int' else float(value)

    def _wrong(self, value: object, rule: str) -> OptionError:
        text = list(value) if isinstance(value, tuple) else value
        unit = f' {self.unit}' if self.unit else ''
        return OptionError(f'parameter {self.name}: {text}{unit} is refused; {rule}')

    def range_text(self) -> str:
        """Return the allowed values as text."""
        if self.choices:
            return ', '.join(self.choices)
        return f'{self.low:g} to {self.high:g}' if self.low < self.high else ''


def parameter(default: Value, description: str, unit: str = '', low: float = 0.0,
              high: float = 0.0, **options: Any) -> Any:
    """Return a dataclass field with the metadata of a parameter; see `Parameter`."""
    return field(default=default, metadata={
        'description': description, 'unit': unit, 'low': low, 'high': high, **options})


# Maximum number of joints of the node; `fit` takes twelve.
MAX_JOINTS = 10


@dataclass(frozen=True)
class Parameters:
    """
    The parameters of the node: the options of the gate, the epochs, the fits and the feed-forward.

    :raises OptionError: if a value is refused (`Parameter.parse`), or two contradict each other.
    """

    autostart: bool = parameter(True, 'Configure and activate at the start.', read_only=True)
    diagnostics_rate: float = parameter(
        1.0, 'Rate of `/diagnostics`.', 'Hz', 0.1, 20.0, read_only=True)
    joints: tuple[str, ...] = parameter(
        (), 'Joint names, in the order of `~/commands`; empty: those of the model file, else of '
        'the first message. Set it if a gripper or several arms publish on the topic.',
        read_only=True)
    effort_scale: tuple[float, ...] = parameter(
        (), 'Torque per unit of the effort field, sign included: the torque constant if effort is '
        'a motor current, -1 if its sign is opposite; empty: 1.', 'N·m per unit', -1e6, 1e6,
        read_only=True)
    robot_description: str = parameter(
        'auto', 'Source of the axes, the continuous joints and the effort limits of the arm: '
        '`auto` subscribes to the topic `robot_description`, `off` uses none, any other value is '
        'the text of a URDF.', read_only=True, may_be_off=True)
    continuous_joints: tuple[str, ...] = parameter(
        (), 'Continuous joints, in addition to those of the robot description.', read_only=True)
    max_age: float = parameter(
        0.3, 'Largest difference between the stamp of a joint state and the clock; others are '
        'dropped. 0 accepts any stamp: of played recordings, and of drivers with another clock.',
        's', 0.0, 3600.0)
    max_speed: float = parameter(
        0.15, 'Maximum joint speed of samples that are learned from.', 'rad/s', 0.001, 10.0)
    auto_fit: bool = parameter(
        True, 'Fit automatically in an open epoch. If false, only `~/refit` fits.')
    formulation: str = parameter(
        'auto', 'Formulation of the model (docs/method.md): `potential`, `chain`, `per_joint`, or '
        '`auto`, a chain or a potential.', choices=('auto', 'potential', 'chain', 'per_joint'))
    effects: tuple[str, ...] = parameter(
        (), 'Effects that a full fit estimates jointly with gravity, as `NAME` or `NAME:JOINT`. '
        'Call `~/refit` after a change.')
    accept: tuple[str, ...] = parameter(
        (), 'Facts about the samples for which a first model is refused otherwise, by their names '
        'in the reply of `~/refit`, such as `effort_unit`.',
        choices=tuple(Kind))
    settle_time: float = parameter(
        0.5, 'Time after `~/payload_changed` during which nothing is learned: the payload may '
        'swing.', 's', 0.0, 60.0)
    min_samples: int = parameter(
        30, 'Training samples for the first fit of an epoch, if the change of a model can be '
        'fitted. Otherwise, and after faulty effort, it is 100.', 'samples', 10, 1500)
    full_samples: int = parameter(
        500, 'Number of samples at which a last fit closes the epoch, once each joint has moved '
        'over 0.2 rad.', 'samples', 20, 1500)
    max_payload: float = parameter(
        20.0, 'Largest mass that is attached to or removed from the last link; more is refused.',
        'kg', 0.01, 1000.0)
    max_payload_reach: float = parameter(
        1.0, 'Largest distance of the centre of mass of a payload from the last joint, without '
        'known axes also between neighbouring joints.', 'm', 0.01, 10.0)
    on_suspected_payload: str = parameter(
        'report', 'Action on a suspected payload: `report` publishes an event on '
        '`~/payload_suspected`, `learn` also does what `~/payload_changed` does.',
        choices=('report', 'learn'))
    suspect_after: float = parameter(
        16.0, 'Minimum duration of a change of the torque before a payload is suspected. A hand '
        'that presses straight down has the torque of a weight.', 's', 0.0, 120.0, read_only=True)
    fit_timeout: float = parameter(
        120.0, 'Maximum duration of a fit, with the start of its process, which is then killed. '
        '`~/refit` and `~/diagnose` reply by then.',
        's', 0.1, 3600.0)
    model_file: str = parameter(
        '', 'File of the model: loaded at the start if it exists, written by `~/save_model`.',
        read_only=True)
    auto_save: bool = parameter(False, 'Write the model file whenever a new model is in use.')
    enabled: bool = parameter(
        True, 'Publish torque from the start. `~/enable` changes this at runtime.', read_only=True)
    ramp_time: float = parameter(
        1.0, 'Time of a ramp to another torque. A change by more than a fifth of a torque limit '
        'takes proportionally longer. 0 switches at once.', 's', 0.0, 60.0)
    max_torque: tuple[float, ...] = parameter(
        (), 'Largest published torque; empty: the effort limits of the first robot description. '
        'Without either no torque is published, unless `unlimited_torque` is true.', 'N·m', 0.0,
        100000.0)
    unlimited_torque: bool = parameter(
        False, 'Publish torque although no torque limits are known.')
    max_torque_rate: tuple[float, ...] = parameter(
        (500.0,), 'Largest rate of change of the published torque; empty: no limit.', 'N·m/s',
        0.001, 1e6)
    servo_stiffness: tuple[float, ...] = parameter(
        (), 'For position-controlled servos: torque per angle by which a joint stays behind its '
        'goal; it gives `~/position_offset`.', 'N·m/rad', 0.1, 1e6, read_only=True)
    max_position_offset: float = parameter(
        0.2, 'Largest position offset: a stiffness in another unit would otherwise move the arm. '
        'A softer servo requires more.', 'rad', 0.001, 1.5, read_only=True)
    extrapolation_margin: float = parameter(
        1.0, 'Distance outside the trained range up to which the model is used; further outside '
        'the torque is that of the nearest pose within it. At most 0.1 rad for a `per_joint` '
        'model.', 'rad', 0.01, 10.0)
    stale_after: float = parameter(
        0.3, 'Time without a usable joint state after which input is stale. Set it above the '
        'period of `joint_states`.', 's', 0.005, 10.0)
    stale_action: str = parameter(
        'fade', 'Action on stale input: the last torque is held, with `fade` for `hold_time` and '
        'then reduced to zero, with `hold` forever.', choices=('fade', 'hold'))
    hold_time: float = parameter(
        0.5, 'Time for which the last torque is held after input became stale.', 's', 0.0, 3600.0)
    fade_time: float = parameter(
        2.0, 'Time in which the torque then falls to zero. Zero torque drops an arm without '
        'brakes.', 's', 0.0, 3600.0)

    def __post_init__(self) -> None:
        for row in TABLE:
            object.__setattr__(self, row.name, row.parse(getattr(self, row.name)))
        self.check()

    def check(self, names: tuple[str, ...] = ()) -> None:
        """
        Check the consistency of several parameters.

        :param names: the joints of the arm where they are known.
        :raises OptionError: if two parameters contradict each other, or an effect or a joint is
            unknown.
        """
        known = self.joints or names
        n = len(known)
        for name in ('effort_scale', 'max_torque', 'max_torque_rate', 'servo_stiffness'):
            count = len(getattr(self, name))
            if n and count not in (0, 1, n):
                raise OptionError(f'parameter {name}: {count} values for {n} joints '
                                  f'({", ".join(known)}); give one for all or one per joint')
        if known and (unknown := sorted(set(self.continuous_joints) - set(known))):
            raise OptionError(f'parameter continuous_joints: {", ".join(unknown)} is not among '
                              f'the joints {", ".join(known)}')
        if len(self.joints) > MAX_JOINTS:
            raise OptionError(f'parameter joints: {len(self.joints)} joints; the node '
                              f'takes at most {MAX_JOINTS}')
        if 0.0 in self.effort_scale:
            raise OptionError('parameter effort_scale: 0 would erase the effort of a joint; '
                              'remove the joint from `joints` instead')
        if known:
            try:
                requests(self.effects, known)
            except OptionError as problem:
                raise OptionError(f'parameter effects: {problem}') from problem
        if self.min_samples > self.full_samples:
            raise OptionError(f'parameter min_samples: {self.min_samples} is more than '
                              f'full_samples, {self.full_samples}')


TABLE = tuple(Parameter(each.name, _KINDS[str(each.type)], each.default,  # type: ignore[arg-type]
                        **each.metadata) for each in fields(Parameters))
BY_NAME = {row.name: row for row in TABLE}
