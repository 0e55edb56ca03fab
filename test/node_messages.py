"""Messages for the node without ROS around it."""


def heard(node, message, now, arrival=0.0):
    """Give a message to a `NodeCore` as its node does; return what was read, and the torque."""
    reading, tau = node.message(message, now, arrival)
    if reading is not None:
        node.learn(reading, now)
    return reading, tau
