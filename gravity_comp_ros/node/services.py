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
    The services, from configuration to cleanup.

    :param core: returns the core of the node, None while it is not active.
    :param now: returns the time for ramps in s.
    """

    def __init__(self, node: Node, core: Callable[[], NodeCore | None],
                 now: Callable[[], float]) -> None:
        self._node, self._core = node, core
        # Fits and disks are slow: these reply later, while joint states are handled.
        waiting = ReentrantCallbackGroup()
        self._services = [
            node.create_service(Trigger, f'~/{name}', self._deferred(start),
                                qos_profile=SERVICE_QOS, callback_group=waiting)
            for name, start in (('refit', NodeCore.refit), ('diagnose', NodeCore.diagnose),
                                ('save_model', NodeCore.save))]
        immediate: dict[str, tuple[type, Callable[[NodeCore, Any], Answer]]] = {
            'payload_changed': (Trigger, lambda core, _: core.payload_changed(now())),
            'rollback': (Trigger, lambda core, _: core.rollback(now())),
            'enable': (SetBool, lambda core, request: core.enable(request.data))}
        self._services += [
            node.create_service(kind, f'~/{name}', self._immediate(answer),
                                qos_profile=SERVICE_QOS)
            for name, (kind, answer) in immediate.items()]

    def destroy(self) -> None:
        """Destroy all services."""
        for service in self._services:
            self._node.destroy_service(service)

    def _immediate(self, answer: Callable[[NodeCore, Any], Answer]) -> Callable[[Any, Any], Any]:
        def respond(request: Any, response: Any) -> Any:
            core = self._core()
            return self._logged(response, (False, INACTIVE) if core is None
                                else answer(core, request))
        return respond

    def _deferred(self, start: Callable[[NodeCore, float, Reply], None]) -> Callable[
            [Any, Any], Coroutine[Any, Any, Any]]:
        async def respond(_: Any, response: Any) -> Any:
            future, core = Future(executor=self._node.executor), self._core()
            if core is None:
                future.set_result((False, INACTIVE))
            else:
                start(core, time.monotonic(), lambda *answer: _complete(future, answer))
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
