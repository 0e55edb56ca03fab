"""
Executor that gives joint states priority.

The executors of rclpy collect all services, timers and guards of a node for each message, which
takes longer than this node's handling of the message. Here the input has a wait set of its own,
created once, and timers are called directly, without a task. All other callbacks run between
messages in the same thread, so no lock is needed.
"""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.executors import (ExternalShutdownException, ShutdownException,
                             SingleThreadedExecutor, TimeoutException)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription

# Period of timers and services during continuous input, s. In a pause of the input they run at
# once.
TIMER_PERIOD = 0.01
# Period of other callbacks during continuous input, s. The search of rclpy for them takes as long
# as a message, so that at 1 kHz it delays one message in two hundred.
OTHERS_PERIOD = 0.2
# Time without input that counts as a pause, s.
PAUSE = 0.005
# Maximum time for other callbacks, s.
OTHERS_DURATION = 0.002
# Maximum number of messages that are taken at once: the depth of the queue.
MAX_MESSAGES = 100


class InputGroup(CallbackGroup):
    """Callback group of the input, which rclpy's own executor code must not execute."""

    def can_execute(self, entity: Any) -> bool:
        """Return False: only `InputFirstExecutor` executes the input."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False, as `can_execute`."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""


class InputFirstExecutor(SingleThreadedExecutor):
    """
    Executor that handles the input of a node first.

    :param subscription: returns the subscription of the input, None while there is none.
    :param handle: called with all waiting messages, in order of arrival.
    :param context: None for the global one.
    """

    def __init__(self, subscription: Callable[[], Subscription | None],
                 handle: Callable[[list[Any]], None], context: Context | None = None) -> None:
        super().__init__(context=context)
        self._subscription, self._handle = subscription, handle
        self._served: Subscription | None = None
        self._wait_set: Any = None
        self._services: list[Any] = []
        self._calls: Any = None

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Shut down; release the input before the node is destroyed."""
        self._served = self._wait_set = self._calls = None
        self._services = []
        return bool(super().shutdown(timeout_sec))

    def spin(self) -> None:
        """
        Run until the context ends.

        :raises ExternalShutdownException: when it has ended.
        """
        timers_due = others_due = 0.0
        while self._context.ok() and not self._is_shutdown:
            subscription = self._subscription()
            if subscription is None:
                self.spin_once(timeout_sec=0.05)
                continue
            received = self._handle_input(subscription, PAUSE)
            now = time.monotonic()
            if not received or now >= others_due:
                self._handle_others(now + OTHERS_DURATION)
                others_due = time.monotonic() + OTHERS_PERIOD
            elif now >= timers_due:
                self._call_timers()
                if self._is_called():
                    self._handle_others(now + OTHERS_DURATION)
            else:
                continue
            timers_due = time.monotonic() + TIMER_PERIOD
        raise ExternalShutdownException()

    def _handle_input(self, subscription: Subscription, timeout: float) -> bool:
        """Handle all waiting messages at once, and return whether there were any."""
        if subscription is not self._served:
            self._served = subscription
            self._wait_set = rclpy_implementation.WaitSet(
                1, 0, 0, 0, 0, 0, self._context.handle)
        handle = subscription.handle
        with handle, self._context.handle:
            self._wait_set.clear_entities()
            self._wait_set.add_subscription(handle)
            self._wait_set.wait(int(timeout * 1e9))
            messages: list[Any] = []
            while len(messages) < MAX_MESSAGES and (
                    taken := handle.take_message(subscription.msg_type, False)) is not None:
                messages.append(taken[0])
        if messages:
            self._handle(messages)
        return bool(messages)

    def _call_timers(self) -> None:
        """Call the timers that are due; their callbacks are functions, no coroutines."""
        for node in self.get_nodes():
            for timer in node.timers:
                if timer.handle.is_timer_ready():
                    timer.handle.call_timer()
                    timer.callback()

    def _is_called(self) -> bool:
        """Return whether a request waits: one of `~/enable` stops the torque."""
        services = [service for node in self.get_nodes() for service in node.services]
        if services != self._services:
            self._services = services
            self._calls = rclpy_implementation.WaitSet(
                0, 0, 0, 0, len(services), 0, self._context.handle)
        if not services:
            return False
        self._calls.clear_entities()
        for service in services:
            self._calls.add_service(service.handle)
        self._calls.wait(0)
        return bool(self._calls.get_ready_entities('service'))

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
            if handler.exception() is not None:
                raise handler.exception()
            if not handler.done():
                waiting.append(handler)
