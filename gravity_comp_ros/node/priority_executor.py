"""
Executor that gives joint states priority.

The executors of rclpy collect all services, timers and guards of a node for each message, which
takes longer than this node's handling of the message. Here the input has a wait set of its own,
created once, as has the check whether other entities are ready. Timers are called directly,
without a task. All other callbacks run between messages in the same thread, so no lock is needed.
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
from rclpy.node import Node
from rclpy.subscription import Subscription

# Period of timers and services during continuous input, s. In a pause of the input they run at
# once.
OTHERS_PERIOD = 0.01
# Period of the full check by rclpy, s, which takes as long as a message. The short check omits
# events of publishers, guard conditions and coroutines.
FULL_CHECK_PERIOD = 0.2
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


class ReadyPoll:
    """
    Calls timers, and checks whether entities other than the input are ready.

    :param node: node with the subscriptions, clients and services to check.
    :param context: context of the node.
    """

    def __init__(self, node: Node, context: Context) -> None:
        self._node, self._context = node, context
        self._watched: list[Any] = []
        self._wait_set: Any = None

    def call_timers(self) -> None:
        """Call the timers that are due; their callbacks are functions, no coroutines."""
        for timer in self._node.timers:
            if timer.handle.is_timer_ready():
                timer.handle.call_timer()
                timer.callback()

    def is_ready(self) -> bool:
        """Return whether a message or a request is waiting."""
        node = self._node
        subscriptions = [s for s in node.subscriptions
                         if not isinstance(s.callback_group, InputGroup)]
        clients, services = list(node.clients), list(node.services)
        watched = [*subscriptions, *clients, *services]
        if watched != self._watched:
            self._watched = watched
            self._wait_set = rclpy_implementation.WaitSet(
                len(subscriptions), 0, 0, len(clients), len(services), 0, self._context.handle)
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in subscriptions:
            wait_set.add_subscription(subscription.handle)
        for client in clients:
            wait_set.add_client(client.handle)
        for service in services:
            wait_set.add_service(service.handle)
        wait_set.wait(0)
        return any(wait_set.get_ready_entities(kind)
                   for kind in ('subscription', 'client', 'service'))


class InputFirstExecutor(SingleThreadedExecutor):
    """
    Executor that handles the input of a node first.

    :param subscription: returns the subscription of the input, None while there is none.
    :param handle: called with all waiting messages, in order of arrival.
    """

    def __init__(self, subscription: Callable[[], Subscription | None],
                 handle: Callable[[list[Any]], None]) -> None:
        super().__init__()
        self._subscription, self._handle = subscription, handle
        self._polls: list[ReadyPoll] = []
        self._served: Subscription | None = None
        self._wait_set: Any = None

    def add_node(self, node: Node) -> bool:
        """Add a node; return False if it has been added already."""
        added = bool(super().add_node(node))
        self._polls = [ReadyPoll(each, self._context) for each in self.get_nodes()]
        return added

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Shut down; release the entities of the node before the node is destroyed."""
        self._polls, self._served, self._wait_set = [], None, None
        return bool(super().shutdown(timeout_sec))

    def spin(self) -> None:
        """
        Run until the context ends.

        :raises ExternalShutdownException: when it has ended.
        """
        short_due = full_due = 0.0
        while self._context.ok() and not self._is_shutdown:
            subscription = self._subscription()
            if subscription is None:
                self.spin_once(timeout_sec=0.05)
                continue
            received = self._handle_input(subscription, PAUSE)
            now = time.monotonic()
            if now >= full_due or not received:
                self._handle_others(now + OTHERS_DURATION)
                full_due = time.monotonic() + FULL_CHECK_PERIOD
            elif now >= short_due:
                self._handle_ready_others(now + OTHERS_DURATION)
            else:
                continue
            short_due = time.monotonic() + OTHERS_PERIOD
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

    def _handle_others(self, until: float) -> None:
        """Run all other callbacks that are ready, at most until this time."""
        while time.monotonic() < until:
            try:
                handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0)
            except (TimeoutException, ShutdownException):
                return
            handler()
            if handler.exception() is not None:
                raise handler.exception()

    def _handle_ready_others(self, until: float) -> None:
        """Call the timers that are due; run other callbacks if a short check finds any."""
        for poll in self._polls:
            poll.call_timers()
            if poll.is_ready():
                self._handle_others(until)
