"""
Start, spin and shut down the node, with an executor that gives joint states priority.

The executors of rclpy collect all services, timers and guards of a node for each message, which
takes longer than this node's handling of the message. Here the input and the services share a
wait set, and timers are called directly, without a task. All other callbacks run between messages
in the same thread, so no lock is needed. The `EventsExecutor` of rclpy 7.1.6 is as fast
(docs/node.md), but executes no coroutine of a service.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import gc
import sys
import time
from typing import Any

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.node.node import GravityCompNode
from gravity_comp_ros.node.options import NODE
import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import (ExternalShutdownException, ShutdownException,
                             SingleThreadedExecutor, TimeoutException)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.subscription import Subscription

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
        executor = InputFirstExecutor(lambda: node.subscription, node.on_joint_states,
                                      node.report)
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
        node.end_torque(problem)
    return FAILED


class InputFirstExecutor(SingleThreadedExecutor):
    """
    Executor that handles the input of a node first.

    :param subscription: returns the subscription of the input, None while there is none.
    :param handle: called with all waiting messages, in order of arrival.
    :param failed: called with an error of another callback than the input and the timers, such as
        that of rclpy about a request; the torque goes on.
    :param context: None for the global one.
    """

    def __init__(self, subscription: Callable[[], Subscription | None],
                 handle: Callable[[list[Any]], None], failed: Callable[[Exception], None],
                 context: Context | None = None) -> None:
        super().__init__(context=context)
        self._subscription, self._handle, self._failed = subscription, handle, failed
        # The subscriptions and services of the wait set, and the wait set.
        self._served: tuple[list[Any], list[Any]] = [], []
        self._wait_set: Any = None

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Shut down; release the input before the node is destroyed."""
        self._served, self._wait_set = ([], []), None
        return bool(super().shutdown(timeout_sec))

    def spin(self) -> None:
        """
        Run until the context ends.

        :raises ExternalShutdownException: when it has ended.
        """
        others_due = 0.0
        while self._context.ok() and not self._is_shutdown:
            received, is_called = self._handle_input(NODE.pause)
            self._call_timers()
            now = time.monotonic()
            if not received or is_called or now >= others_due:
                self._handle_others(now + NODE.others_time)
                others_due = time.monotonic() + NODE.others_period
        raise ExternalShutdownException()

    def _handle_input(self, timeout: float) -> tuple[bool, bool]:
        """
        Handle all waiting messages at once.

        :param timeout: longest time to wait for a message or a request, s.
        :return: whether there were messages, and whether a request waits: one of `~/enable` stops
            the torque.
        """
        subscription = self._subscription()
        served = ([] if subscription is None else [subscription],
                  [service for node in self.get_nodes() for service in node.services])
        if served != self._served or self._wait_set is None:
            self._served = served
            self._wait_set = rclpy_implementation.WaitSet(
                len(served[0]), 0, 0, 0, len(served[1]), 0, self._context.handle)
        wait_set, messages = self._wait_set, list[Any]()
        wait_set.clear_entities()
        for service in served[1]:
            wait_set.add_service(service.handle)
        if subscription is None:
            wait_set.wait(int(timeout * 1e9))
        else:
            handle = subscription.handle
            with handle, self._context.handle:
                wait_set.add_subscription(handle)
                wait_set.wait(int(timeout * 1e9))
                while len(messages) < NODE.messages and (
                        taken := handle.take_message(subscription.msg_type, False)) is not None:
                    messages.append(taken[0])
        is_called = bool(wait_set.get_ready_entities('service'))
        if messages:
            self._handle(messages)
        return bool(messages), is_called

    def _call_timers(self) -> None:
        """Call the timers that are due; their callbacks are functions, no coroutines."""
        for node in self.get_nodes():
            for timer in node.timers:
                if timer.handle.is_timer_ready():
                    timer.handle.call_timer()
                    timer.callback()

    def _handle_others(self, until: float) -> None:
        """
        Run all other callbacks that are ready, at most until this time.

        rclpy returns a coroutine that waits, such as that of a call during a fit, as ready each
        time.
        """
        waiting = []
        while time.monotonic() < until:
            try:
                handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0)
            except (TimeoutException, ShutdownException):
                return
            if handler in waiting:
                return
            handler()
            if (problem := handler.exception()) is not None:
                self._failed(problem)
            if not handler.done():
                waiting.append(handler)
