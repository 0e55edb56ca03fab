"""Services of the node; each reply has a message, which is also logged."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
import time
from typing import Any

from gravity_comp_ros.node.model_history import Reply
from gravity_comp_ros.node.node_core import Answer, NodeCore
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

# With the default depth the eleventh of simultaneous calls is lost without a reply.
SERVICE_QOS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000,
                         reliability=ReliabilityPolicy.RELIABLE)
INACTIVE = 'the node is not active: activate it first'


class Services:
    """
    The services. They exist as long as the node, so that a call that waits is always answered.

    :param core: returns the core of the node, None while it is not active.
    :param now: returns the time for ramps in s.
    """

    def __init__(self, node: Node, core: Callable[[], NodeCore | None],
                 now: Callable[[], float]) -> None:
        self._node, self._core = node, core
        # Fits and disks are slow: these reply later, while joint states are handled.
        waiting = ReentrantCallbackGroup()
        deferred: dict[str, Callable[[NodeCore, Reply], None]] = {
            'refit': lambda core, reply: core.request(time.monotonic(), reply),
            'diagnose': lambda core, reply: core.request(time.monotonic(), reply, True),
            'save_model': lambda core, reply: core.models.save(reply)}
        for name, start in deferred.items():
            node.create_service(Trigger, f'~/{name}', self._deferred(start),
                                qos_profile=SERVICE_QOS, callback_group=waiting)
        immediate: dict[str, tuple[type, Callable[[NodeCore, Any], Answer]]] = {
            'payload_changed': (Trigger, lambda core, _: core.payload_changed(now())),
            'rollback': (Trigger, lambda core, _: core.rollback(now())),
            'enable': (SetBool, lambda core, request: core.enable(request.data))}
        for name, (kind, answer) in immediate.items():
            node.create_service(kind, f'~/{name}', self._immediate(answer),
                                qos_profile=SERVICE_QOS)

    def _immediate(self, answer: Callable[[NodeCore, Any], Answer]) -> Callable[[Any, Any], Any]:
        def respond(request: Any, response: Any) -> Any:
            core = self._core()
            return self._logged(response, (False, INACTIVE) if core is None
                                else answer(core, request))
        return respond

    def _deferred(self, start: Callable[[NodeCore, Reply], None]) -> Callable[
            [Any, Any], Coroutine[Any, Any, Any]]:
        async def respond(_: Any, response: Any) -> Any:
            future, core = Future(executor=self._node.executor), self._core()
            if core is None:
                future.set_result((False, INACTIVE))
            else:
                start(core, lambda *answer: _complete(future, answer))
            return self._logged(response, await future)
        return respond

    def _logged(self, response: Any, answer: Answer) -> Any:
        response.success, response.message = success, text = answer
        # Throttled, because the caller has the reply. rclpy raises an error if one line of code
        # logs with different severities.
        if success:
            self._node.get_logger().info(text, throttle_duration_sec=0.1)
        else:
            self._node.get_logger().warning(text, throttle_duration_sec=0.1)
        return response


def _complete(future: Future, answer: Answer) -> None:
    if not future.done():
        future.set_result(answer)
