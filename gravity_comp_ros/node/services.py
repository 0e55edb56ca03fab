"""The services of the node: each call is answered in words, and logged."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from threading import Thread
import time
from typing import Any

from gravity_comp_ros.node.fit_requests import Reply
from gravity_comp_ros.node.node_core import Answer, NodeCore
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

# By default the eleventh of many calls at once would be lost without an answer.
SERVICE_QOS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000,
                         reliability=ReliabilityPolicy.RELIABLE)
INACTIVE = 'the node is not active: activate it first'


class Services:
    """
    The services, from configuring to cleaning up.

    :param core: returns the core of the node, None while it is not active.
    :param now: returns the time for ramps in s.
    """

    def __init__(self, node: Node, core: Callable[[], NodeCore | None],
                 now: Callable[[], float]) -> None:
        self._node, self._core = node, core
        # These answer later, while joint states go on: a fit and a disk take their time.
        waiting = ReentrantCallbackGroup()
        self._made = [
            node.create_service(Trigger, f'~/{name}', self._later(start),
                                qos_profile=SERVICE_QOS, callback_group=waiting)
            for name, start in (('refit', NodeCore.refit), ('diagnose', NodeCore.diagnose),
                                ('save_model', _save_in_thread))]
        at_once: dict[str, tuple[type, Callable[[NodeCore, Any], Answer]]] = {
            'payload_changed': (Trigger, lambda core, _: core.payload_changed(now())),
            'rollback': (Trigger, lambda core, _: core.rollback(now())),
            'enable': (SetBool, lambda core, request: core.enable(request.data))}
        self._made += [
            node.create_service(kind, f'~/{name}', self._at_once(answer),
                                qos_profile=SERVICE_QOS)
            for name, (kind, answer) in at_once.items()]

    def destroy(self) -> None:
        """Take them away."""
        for service in self._made:
            self._node.destroy_service(service)

    def _at_once(self, answer: Callable[[NodeCore, Any], Answer]) -> Callable[[Any, Any], Any]:
        def respond(request: Any, response: Any) -> Any:
            core = self._core()
            return self._told(response, (False, INACTIVE) if core is None
                              else answer(core, request))
        return respond

    def _later(self, start: Callable[[NodeCore, float, Reply], None]) -> Callable[
            [Any, Any], Coroutine[Any, Any, Any]]:
        async def respond(_: Any, response: Any) -> Any:
            future, core = Future(executor=self._node.executor), self._core()
            if core is None:
                future.set_result((False, INACTIVE))
            else:
                start(core, time.monotonic(), lambda *answer: _settle(future, answer))
            return self._told(response, await future)
        return respond

    def _told(self, response: Any, answer: Answer) -> Any:
        response.success, response.message = success, text = answer
        # A storm of calls must not become a storm of lines: who asked has the answer anyway. A
        # line of code must not change its severity, or rclpy raises an error.
        if success:
            self._node.get_logger().info(text, throttle_duration_sec=0.1)
        else:
            self._node.get_logger().warning(text, throttle_duration_sec=0.1)
        return response


def _save_in_thread(core: NodeCore, _: float, reply: Reply) -> None:
    Thread(target=lambda: reply(*core.save()), daemon=True).start()


def _settle(future: Future, answer: Answer) -> None:
    if not future.done():
        future.set_result(answer)
