"""Declaration of the parameter table as ROS parameters, with descriptors and checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import BY_NAME, Parameter, Parameters, TABLE
from rcl_interfaces.msg import (FloatingPointRange, IntegerRange, ParameterDescriptor,
                                SetParametersResult)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter


_TYPES = {'double[]': RosParameter.Type.DOUBLE_ARRAY, 'string[]': RosParameter.Type.STRING_ARRAY}


class DeclaredParameters:
    """
    The declared parameters of the node; `values` is always a consistent set.

    :param core: returns the core that checks and uses changed values, None if there is none.
    :raises OptionError: if an override is refused.
    """

    def __init__(self, node: Node, core: Callable[[], NodeCore | None]) -> None:
        self._core = core
        self.values = Parameters(**{  # type: ignore[arg-type]
            row.name: _declare(node, row) for row in TABLE})
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            values, core = replace(self.values, **_parsed(parameters)), self._core()
            if core is not None and core.arm is not None:
                core.arm.check(values)
        except OptionError as problem:
            return SetParametersResult(successful=False, reason=str(problem))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[RosParameter]) -> None:
        if ours := _parsed(parameters):
            self.values = replace(self.values, **ours)
            if (core := self._core()) is not None:
                core.set(self.values)


def _parsed(parameters: list[RosParameter]) -> dict[str, Any]:
    """Return the values of the parameters of the table, converted to their types."""
    return {each.name: BY_NAME[each.name].parse(each.value) for each in parameters
            if each.name in BY_NAME}


def unknown_parameter_warnings(node: Node) -> list[str]:
    """Return a warning for each parameter override that the node does not declare."""
    warnings = []
    for name in getattr(node, '_parameter_overrides', {}):
        if node.has_parameter(name) or name.startswith('qos_overrides.'):
            continue
        near = get_close_matches(name, BY_NAME, 1)
        hint = f'; did you mean {near[0]}?' if near else ''
        warnings.append(f'parameter {name} does not exist and has no effect{hint}')
    return warnings


def _declare(node: Node, row: Parameter) -> Any:
    """
    Declare a parameter with its type; return its value.

    An override may be an integer for a double, an empty list, and `off` as YAML reads it, none of
    which has the type of the parameter. An empty list has no type: it is declared without a value.
    """
    overrides = node._parameter_overrides
    value = row.default
    if row.name in overrides:
        value = row.parse(overrides.pop(row.name).value)
    plain = list(value) if isinstance(value, tuple) else value
    node.declare_parameter(row.name, plain if plain != [] else _TYPES[row.kind],
                           _descriptor(row), ignore_override=True)
    return value


def _descriptor(row: Parameter) -> ParameterDescriptor:
    unit = f' [{row.unit}]' if row.unit else ''
    descriptor = ParameterDescriptor(
        name=row.name, description=f'{row.description}{unit}', read_only=row.read_only,
        additional_constraints=row.range_text())
    if row.kind == 'double':
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=row.low, to_value=row.high)]
    elif row.kind == 'int':
        descriptor.integer_range = [
            IntegerRange(from_value=int(row.low), to_value=int(row.high), step=1)]
    return descriptor
