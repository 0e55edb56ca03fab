"""Start, spin and shut down the node."""

from __future__ import annotations

from collections.abc import Sequence
import gc
import sys

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.node.node import GravityCompNode
from gravity_comp_ros.node.priority_executor import InputFirstExecutor
import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import TransitionCallbackReturn


def run(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal ends it; return 0, or 1 with one line if it cannot start."""
    try:
        rclpy.init(args=list(args) if args is not None else None)
        node = GravityCompNode()
    except (GravityCompError, InvalidParameterTypeException,
            InvalidParameterValueException) as problem:
        reason = str(problem).rpartition('Reason: ')[2]
        print(f'gravity_comp_node: {reason}', file=sys.stderr)
        rclpy.try_shutdown()
        return 1
    except Exception:
        # A signal during the construction of the node invalidates its context.
        if rclpy.ok():
            raise
        return 0
    executor = InputFirstExecutor(node.subscription)
    try:
        _spin(node, executor)
    except ExternalShutdownException:
        pass
    except Exception:
        # A signal during a callback invalidates the context, and the callback fails.
        if rclpy.ok():
            raise
    finally:
        node.close()
        # The executor holds entities of the node, so it ends first.
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: GravityCompNode, executor: InputFirstExecutor) -> None:
    executor.add_node(node)
    if node.settings.values.autostart and (
            node.trigger_configure() == TransitionCallbackReturn.SUCCESS):
        node.trigger_activate()
    # Imported modules stay; scanning them in each garbage collection takes milliseconds.
    gc.collect()
    gc.freeze()
    executor.spin()
