"""Messages for `NodeCore` without ROS."""


def send_message(node, message, now, arrival=0.0):
    """Send a message to a `NodeCore` as its node does; return the reading and the torque."""
    reading, tau = node.message(message, now, arrival)
    if reading is not None:
        node.learn(reading, now)
    return reading, tau
