"""An estimated payload as a message."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from geometry_msgs.msg import InertiaStamped
from gravity_comp_ros.export.payload_lines import Payload


def payload_message(payload: Payload, stamp: Time) -> InertiaStamped:
    """Return mass and centre of mass in the frame of the payload; inertias, unknown, are 0."""
    message = InertiaStamped()
    message.header.stamp, message.header.frame_id = stamp, payload.frame
    message.inertia.m = payload.mass.value
    for axis, x in payload.centre.items():
        setattr(message.inertia.com, axis, x.value)
    return message
