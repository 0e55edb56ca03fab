"""Gravity of a serial chain, with unknown axes or those of a URDF."""
