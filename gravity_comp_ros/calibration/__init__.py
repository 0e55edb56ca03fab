"""Calibration of torque: N·m per unit of effort, from a known weight."""
