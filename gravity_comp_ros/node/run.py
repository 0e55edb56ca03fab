"""Start, spin and shut down the node."""

from __future__ import annotations

from collections.abc import Sequence
import gc
import sys
import time
import traceback

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.node.node import GravityCompNode
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.priority_executor import InputFirstExecutor
import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.lifecycle import TransitionCallbackReturn

# Exit code after an error in a callback; a supervisor starts the node again.
FAILED = 3


def run(args: Sequence[str] | None = None) -> int:
    """
    Run the node until a signal ends it.

    :return: 0, 1 with one line if it cannot start, or `FAILED` after an error in a callback.
    """
    sys.setswitchinterval(NODE.switch_interval)
    try:
        rclpy.init(args=list(args) if args is not None else None)
        node = GravityCompNode()
        executor = InputFirstExecutor(lambda: node.subscription, node.on_joint_states)
        try:
            return _spin(node, executor)
        finally:
            node.close()
            # The executor holds entities of the node, so it ends first.
            executor.shutdown()
            node.destroy_node()
    except (GravityCompError, InvalidParameterTypeException,
            InvalidParameterValueException) as problem:
        reason = str(problem).rpartition('Reason: ')[2]
        print(f'gravity_comp_node: {reason}', file=sys.stderr)
        return 1
    except Exception:
        # A signal invalidates the context; then the construction of the node or a callback fails.
        if rclpy.ok():
            raise
        return 0
    finally:
        rclpy.try_shutdown()


def _spin(node: GravityCompNode, executor: InputFirstExecutor) -> int:
    executor.add_node(node)
    if node.settings.values.autostart and (
            node.trigger_configure() == TransitionCallbackReturn.SUCCESS):
        node.trigger_activate()
    # Imported modules stay; scanning them in each garbage collection takes milliseconds.
    gc.collect()
    gc.freeze()
    try:
        executor.spin()
    except Exception as problem:
        if not rclpy.ok():
            raise
        _end_torque(node, problem)
    return FAILED


def _end_torque(node: GravityCompNode, problem: Exception) -> None:
    """
    Bring the published torque to zero after an error in a callback, as on stale input.

    The controller keeps the last torque that it received, so the process must not simply end.
    """
    node.fail(problem, traceback.format_exc())
    while rclpy.ok() and node.end_torque():
        time.sleep(NODE.watch_period)
