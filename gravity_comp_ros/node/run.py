"""Start the node, spin it, and end it cleanly."""

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
    """Run the node until it is told to end; return 0, or 1 with one line if it cannot start."""
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
        # A signal that comes while the node is made invalidates what it is made of.
        if rclpy.ok():
            raise
        return 0
    executor = InputFirstExecutor(node.subscription)
    try:
        _spin(node, executor)
    except ExternalShutdownException:
        pass
    except Exception:
        # A signal invalidates the context in the middle of a callback, which then fails.
        if rclpy.ok():
            raise
    finally:
        node.close()
        # What the executor was about to run is of the node: it lets go first.
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: GravityCompNode, executor: InputFirstExecutor) -> None:
    executor.add_node(node)
    if node.settings.values.autostart and (
            node.trigger_configure() == TransitionCallbackReturn.SUCCESS):
        node.trigger_activate()
    # What has been imported by now stays; looking through it again is a pause of milliseconds.
    gc.collect()
    gc.freeze()
    executor.spin()
