"""Disturbances of simulated recordings: friction, torques of an angle, faults of signals."""

from gravity_comp_ros.simulation.disturbances.friction import (  # noqa: F401
    DifferentialFriction, Friction, LoadFriction, LuGre, ThermalFriction)
from gravity_comp_ros.simulation.disturbances.signals import (  # noqa: F401
    bumper, cogging, delayed_effort, detent, dress_pack, encoder_offset, gauge_drift, gauge_gain,
    gauge_offset, gear, spring_balancer, tilted_base, tool_force)
