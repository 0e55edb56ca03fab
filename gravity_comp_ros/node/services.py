"""Services of the node; each reply has a message, which is also logged."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
import time
from typing import Any

from gravity_comp_ros.node.model_history import Reply
from gravity_comp_ros.node.node_core import NodeCore
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

# With the default depth the eleventh of simultaneous calls is lost without a reply.
SERVICE_QOS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000,
                         reliability=ReliabilityPolicy.RELIABLE)
INACTIVE = 'the node is not active: activate it first'
# Starts the action of a request; the reply is given once, now or later.
Action = Callable[[NodeCore, Any, Reply], None]


class Services:
    """
    The services. They exist as long as the node, so that a call that waits is always answered.

    :param core: returns the core of the node, None while it is not active.
    :param now: returns the time for ramps in s.
    """

    def __init__(self, node: Node, core: Callable[[], NodeCore | None],
                 now: Callable[[], float]) -> None:
        self._node, self._core = node, core
        actions: dict[str, Action] = {
            'payload_changed': lambda core, _, reply: reply(*core.payload_changed(now())),
            'rollback': lambda core, _, reply: reply(*core.rollback(now())),
            'enable': lambda core, request, reply: reply(*core.enable(request.data)),
            'refit': lambda core, _, reply: core.request(time.monotonic(), reply),
            'diagnose': lambda core, _, reply: core.request(time.monotonic(), reply, True),
            'save_model': lambda core, _, reply: core.models.save(reply)}
        # Fits and disks are slow: these reply later, while joint states are handled.
        group = ReentrantCallbackGroup()
        for name, action in actions.items():
            node.create_service(SetBool if name == 'enable' else Trigger, f'~/{name}',
                                self._answered(action), qos_profile=SERVICE_QOS,
                                callback_group=group)

    def _answered(self, action: Action) -> Callable[[Any, Any], Coroutine[Any, Any, Any]]:
        async def respond(request: Any, response: Any) -> Any:
            future, core = Future(executor=self._node.executor), self._core()

            def reply(success: bool, text: str) -> None:
                if not future.done():
                    future.set_result((success, text))

            if core is None:
                reply(False, INACTIVE)
            else:
                action(core, request, reply)
            response.success, response.message = success, text = await future
            # Throttled, because the caller has the reply. rclpy raises an error if one line of
            # code logs with different severities.
            if success:
                self._node.get_logger().info(text, throttle_duration_sec=0.1)
            else:
                self._node.get_logger().warning(text, throttle_duration_sec=0.1)
            return response
        return respond
