"""
The numbers of a model as a message, for a controller that runs the exported C source.

`layout.dim[0].label` is the layout in hexadecimal, its size the number of values; the labels of
the other dimensions, all of size 1, name the values.
"""

from __future__ import annotations

from gravity_comp_ros.export.numbers import Parameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

# A controller that starts later receives the last model.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def model_message(parameters: Parameters) -> Float64MultiArray:
    """Return the message of the numbers of a model (`export.c_source.parameters_of`)."""
    count = len(parameters.values)
    message = Float64MultiArray(data=parameters.values.tolist())
    message.layout.dim = [
        MultiArrayDimension(label=f'{parameters.layout:08x}', size=count, stride=count),
        *(MultiArrayDimension(label=label, size=1, stride=1) for label in parameters.labels)]
    return message
