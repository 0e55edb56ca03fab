"""The table of parameters as ROS parameters: descriptors, and checks on every set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node.parameter import Parameter
from gravity_comp_ros.node.parameters import BY_NAME, Parameters, TABLE
from rcl_interfaces.msg import (FloatingPointRange, IntegerRange, ParameterDescriptor,
                                SetParametersResult)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter


class Settings:
    """
    The node's parameters, declared and checked; `values` always holds a set that fits together.

    :param node: where to declare them.
    :param check: called with every new set before it counts; raises OptionError.
    :param changed: called with every new set once it counts.
    :raises rclpy.exceptions.InvalidParameterValueException: if an override is refused.
    """

    def __init__(self, node: Node, check: Callable[[Parameters], None],
                 changed: Callable[[Parameters], None]) -> None:
        self._declared = False
        self._extra_check = check
        self._changed = changed
        node.add_on_set_parameters_callback(self._check)
        given = {}
        for row in TABLE:
            default = list(row.default) if isinstance(row.default, tuple) else row.default
            node.declare_parameter(row.name, default, _descriptor(row))
            given[row.name] = row.parse(node.get_parameter(row.name).value)
        self.values = Parameters(**given)  # type: ignore[arg-type]
        self._declared = True
        node.add_post_set_parameters_callback(self._apply)

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            ours = _parsed(parameters)
            if self._declared:
                self._extra_check(replace(self.values, **ours))
        except OptionError as problem:
            return SetParametersResult(successful=False, reason=str(problem))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[RosParameter]) -> None:
        if ours := _parsed(parameters):
            self.values = replace(self.values, **ours)
            self._changed(self.values)


def _parsed(parameters: list[RosParameter]) -> dict[str, Any]:
    """Return the values of those parameters that are in the table, each in its own type."""
    return {each.name: BY_NAME[each.name].parse(each.value) for each in parameters
            if each.name in BY_NAME}


def strange_parameters(node: Node) -> list[str]:
    """Return a warning for each parameter that was given and that the node does not have."""
    found = []
    for name in getattr(node, '_parameter_overrides', {}):
        if node.has_parameter(name) or name.startswith('qos_overrides.'):
            continue
        near = get_close_matches(name, BY_NAME, 1)
        hint = f'; did you mean {near[0]}?' if near else ''
        found.append(f'parameter {name} is none of this node and has no effect{hint}')
    return found


def _descriptor(row: Parameter) -> ParameterDescriptor:
    unit = f' [{row.unit}]' if row.unit else ''
    constraints = row.range_text()
    # Dynamic typing, because rclpy takes an empty list for one of bytes and would refuse whole
    # numbers for a double; `Parameter.parse` checks the type, and says what is wrong with it.
    descriptor = ParameterDescriptor(
        name=row.name, description=f'{row.description}{unit}', read_only=row.read_only,
        additional_constraints=constraints, dynamic_typing=True)
    if row.low is not None and row.high is not None:
        if row.kind == 'double':
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=row.low, to_value=row.high)]
        elif row.kind == 'int':
            descriptor.integer_range = [
                IntegerRange(from_value=int(row.low), to_value=int(row.high), step=1)]
    return descriptor
