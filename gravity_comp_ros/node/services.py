"""Services of the node; each reply has a message, which is also logged."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
import time
from typing import Any

from gravity_comp_ros.node.learner import DIAGNOSIS, FIT, Learner
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
NO_JOINTS = 'no joint states yet: check the topic and the driver'
# Starts the action of a request; the reply is given once, now or later.
Action = Callable[[Learner, Any, Reply], None]


def create_services(node: Node, core: Callable[[], NodeCore | None],
                    now: Callable[[], float]) -> None:
    """
    Create the services. They exist as long as the node, so that a call is always answered.

    :param core: returns the core of the node, None while it is not active.
    :param now: returns the time for ramps in s.
    """
    actions: dict[str, Action] = {
        'payload_changed': lambda learner, _, reply: reply(*learner.payload_changed(now())),
        'rollback': lambda learner, _, reply: reply(*learner.roll_back(now())),
        'enable': lambda learner, request, reply: reply(*learner.arm.enable(request.data)),
        'refit': lambda learner, _, reply: learner.request(FIT, time.monotonic(), reply),
        'diagnose': lambda learner, _, reply: learner.request(DIAGNOSIS, time.monotonic(), reply),
        'save_model': lambda learner, _, reply: learner.models.save(reply)}
    # Fits and disks are slow: these reply later, while joint states are handled.
    group = ReentrantCallbackGroup()
    for name, action in actions.items():
        node.create_service(SetBool if name == 'enable' else Trigger, f'~/{name}',
                            _answered(node, core, action), qos_profile=SERVICE_QOS,
                            callback_group=group)


def _answered(node: Node, core: Callable[[], NodeCore | None],
              action: Action) -> Callable[[Any, Any], Coroutine[Any, Any, Any]]:
    async def respond(request: Any, response: Any) -> Any:
        future, active = Future(executor=node.executor), core()

        def reply(success: bool, text: str) -> None:
            if not future.done():
                future.set_result((success, text))

        if active is None or active.learner is None:
            reply(False, INACTIVE if active is None else NO_JOINTS)
        else:
            action(active.learner, request, reply)
        response.success, response.message = success, text = await future
        # Throttled, because the caller has the reply. rclpy raises an error if one line of code
        # logs with different severities.
        if success:
            node.get_logger().info(text, throttle_duration_sec=0.1)
        else:
            node.get_logger().warning(text, throttle_duration_sec=0.1)
        return response
    return respond
