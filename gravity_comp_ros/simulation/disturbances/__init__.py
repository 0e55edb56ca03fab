"""Disturbances of simulated recordings: friction, torques of an angle, faults of signals."""

from gravity_comp_ros.simulation.disturbances.friction import (
    DifferentialFriction, Friction, GreasedGear, LoadFriction, LuGre, ThermalFriction)
from gravity_comp_ros.simulation.disturbances.joint_torque import (
    Bumper, Cogging, Detent, DressPack, SpringBalancer)
from gravity_comp_ros.simulation.disturbances.signals import (
    Backlash, DelayedEffort, ElasticGear, EncoderOffset, GaugeDrift, GaugeGain, GaugeOffset,
    TiltedBase, ToolForce)

__all__ = [
    'Backlash', 'Bumper', 'Cogging', 'DelayedEffort', 'Detent', 'DifferentialFriction',
    'DressPack', 'ElasticGear', 'EncoderOffset', 'Friction', 'GaugeDrift', 'GaugeGain',
    'GaugeOffset', 'GreasedGear', 'LoadFriction', 'LuGre', 'SpringBalancer', 'ThermalFriction',
    'TiltedBase', 'ToolForce']
