"""
An executor that serves joint states first.

rclpy's executors collect every service, timer and guard of a node anew for each message, which
takes longer than everything that this node does with one. Here the input has a wait set of its
own, made once, and so has the question whether anything else is ready; timers are called without
a task each. All else runs in the pauses between messages, in the same thread, so nothing needs a
lock.
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

# s; how often timers and services get their turn while messages come one after the other. After a
# pause of the messages they get it at once.
TURN_EVERY = 0.01
# s; how often rclpy looks through everything, which takes as long as a message. The short look
# leaves out events of publishers, guard conditions and coroutines.
LOOK_THROUGH_EVERY = 0.2
PAUSE = 0.005
# s; how long a turn may take.
TURN_LENGTH = 0.002
# Messages handled in a row before services get a turn, should there be no pause.
BURST = 20


class InputGroup(CallbackGroup):
    """Of the subscription that the lane serves: other executors leave it alone."""

    def can_execute(self, entity: Any) -> bool:
        """Return False, to anybody who asks."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False: nobody else may begin."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: nobody else began."""


class Lookout:
    """
    Calls timers, and asks whether anything but joint states waits, with a wait set that is kept.

    :param node: whose subscriptions, clients and services are watched.
    :param context: of the node.
    """

    def __init__(self, node: Node, context: Context) -> None:
        self._node, self._context = node, context
        self._watched: list[Any] = []
        self._wait_set: Any = None

    def call_timers(self) -> None:
        """Call the timers that are due; their callbacks are plain functions."""
        for timer in self._node.timers:
            if timer.handle.is_timer_ready():
                timer.handle.call_timer()
                timer.callback()

    def is_ready(self) -> bool:
        """Return whether a message or a request waits."""
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
    Spins one node.

    :param subscription: returns the subscription to serve first, None while there is none.
    """

    def __init__(self, subscription: Callable[[], Subscription | None]) -> None:
        super().__init__()
        # How often a burst ended with messages still waiting, since the start.
        self.full_bursts = 0
        self._find = subscription
        self._lookouts: list[Lookout] = []
        self._served: Subscription | None = None
        self._wait_set: Any = None

    def add_node(self, node: Node) -> bool:
        """Spin a node as well; return False if it is there already."""
        added = bool(super().add_node(node))
        self._lookouts = [Lookout(each, self._context) for each in self.get_nodes()]
        return added

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End all work; what is kept here is of the node, and goes before it."""
        self._lookouts, self._served, self._wait_set = [], None, None
        return bool(super().shutdown(timeout_sec))

    def spin(self) -> None:
        """
        Run until the context ends.

        :raises ExternalShutdownException: when it does.
        """
        due = thorough = 0.0
        while self._context.ok() and not self._is_shutdown:
            subscription = self._find()
            if subscription is None:
                self.spin_once(timeout_sec=0.05)
                continue
            came = self._serve(subscription, PAUSE)
            now = time.monotonic()
            if now >= thorough or not came:
                self._turn(now + TURN_LENGTH)
                thorough = time.monotonic() + LOOK_THROUGH_EVERY
            elif now >= due:
                self._short_turn(now + TURN_LENGTH)
            else:
                continue
            due = time.monotonic() + TURN_EVERY
        raise ExternalShutdownException()

    def _serve(self, subscription: Subscription, timeout: float) -> bool:
        """Wait for input, and handle what is there, up to a burst; return whether any came."""
        if subscription is not self._served:
            self._served = subscription
            self._wait_set = rclpy_implementation.WaitSet(
                1, 0, 0, 0, 0, 0, self._context.handle)
        handle = subscription.handle
        with handle, self._context.handle:
            self._wait_set.clear_entities()
            self._wait_set.add_subscription(handle)
            self._wait_set.wait(int(timeout * 1e9))
            for count in range(BURST):
                taken = handle.take_message(subscription.msg_type, False)
                if taken is None:
                    return count > 0
                subscription.callback(taken[0])
        self.full_bursts += 1
        return True

    def _turn(self, until: float) -> None:
        """Run everything else that is ready, as long as the turn lasts."""
        while time.monotonic() < until:
            try:
                handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0)
            except (TimeoutException, ShutdownException):
                return
            handler()
            if handler.exception() is not None:
                raise handler.exception()

    def _short_turn(self, until: float) -> None:
        """Call the timers that are due, and run the rest where something of it is ready."""
        for lookout in self._lookouts:
            lookout.call_timers()
            if lookout.is_ready():
                self._turn(until)
