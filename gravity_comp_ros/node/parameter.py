"""A parameter of the node: its type, range and description, and the check of a value."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, Field, field, MISSING
import math
from typing import Any

from gravity_comp_ros.errors import OptionError

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

NUMBERS = ('int', 'double', 'double[]')
ARRAYS = ('double[]', 'string[]')


@dataclass(frozen=True)
class Parameter:
    """
    One row of the table of parameters.

    `kind` is bool, int, double, string, double[] or string[]. `low` and `high` bound each number,
    both included; `choices` lists the allowed strings, empty for any. With `may_be_off` the value
    `off` is allowed, which YAML reads as false.
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
    may_be_off: bool = False

    def parse(self, value: object) -> Value:
        """
        Return `value` in the type of the parameter; integers are accepted for a double.

        :raises OptionError: if the type is wrong, or a value is out of range, not finite or
            not among the choices; the message gives the allowed values.
        """
        if self.kind in ARRAYS:
            if value is None:
                # An empty list in YAML or after -p on a command line.
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
        if value is False and self.may_be_off:
            return 'off'
        if not isinstance(value, str):
            raise self._wrong(value, 'it must be text')
        if self.choices and value not in self.choices:
            raise self._wrong(repr(value), f'it must be one of {", ".join(self.choices)}')
        return value

    def _wrong(self, value: object, rule: str) -> OptionError:
        text = list(value) if isinstance(value, tuple) else value
        unit = f' {self.unit}' if self.unit and self.kind in NUMBERS else ''
        return OptionError(f'parameter {self.name}: {text}{unit} is refused; {rule}')

    def range_text(self) -> str:
        """Return the allowed values as text."""
        if self.choices:
            return ', '.join(self.choices)
        if self.low is None and self.high is None:
            return ''
        low = '' if self.low is None else f'{self.low:g}'
        high = '' if self.high is None else f'{self.high:g}'
        return f'{low} to {high}'.strip()


def parameter(default: Value, description: str, unit: str = '', low: float | None = None,
              high: float | None = None, choices: tuple[str, ...] = (),
              read_only: bool = False, may_be_off: bool = False) -> Any:
    """Return a dataclass field with the metadata of a parameter; see `Parameter`."""
    return field(default=default, metadata={
        'description': description, 'unit': unit, 'low': low, 'high': high, 'choices': choices,
        'read_only': read_only, 'may_be_off': may_be_off})


# ROS type of each Python type of a field.
_KINDS = {'bool': 'bool', 'int': 'int', 'float': 'double', 'str': 'string',
          'tuple[float, ...]': 'double[]', 'tuple[str, ...]': 'string[]'}


def row_of(each: Field[Any]) -> Parameter:
    """Return the table row of a field created by `parameter`."""
    assert each.default is not MISSING
    return Parameter(each.name, _KINDS[str(each.type)], each.default, **each.metadata)
