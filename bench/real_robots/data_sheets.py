"""
Robot descriptions of three real arms, with joint axes from the makers' data sheets.

Masses are not real: every link has 1 kg, so that Pinocchio accepts the description as well.
"""

from __future__ import annotations

import math

_HALF = math.pi / 2
# D-H parameters after J. J. Craig: a (m) and alpha (rad) of the previous link, d (m) of the joint.
_UR10 = ((0.0, 0.0, 0.1273), (0.0, _HALF, 0.0), (-0.612, 0.0, 0.0), (-0.5723, 0.0, 0.163941),
         (0.0, _HALF, 0.1157), (0.0, -_HALF, 0.0922))
_PANDA = ((0.0, 0.0, 0.333), (0.0, -_HALF, 0.0), (0.0, _HALF, 0.316), (0.0825, _HALF, 0.0),
          (-0.0825, -_HALF, 0.384), (0.0, _HALF, 0.0), (0.088, _HALF, 0.0))
_MED7 = ((0.0, 0.0, 0.34), (0.0, -_HALF, 0.0), (0.0, _HALF, 0.4), (0.0, _HALF, 0.0),
         (0.0, -_HALF, 0.4), (0.0, -_HALF, 0.0), (0.0, _HALF, 0.126))
ARMS = {'ur10': _UR10, 'panda': _PANDA, 'med7': _MED7}


def description(arm: str, joints: tuple[str, ...]) -> str:
    """Return the URDF of an arm (a key of `ARMS`) with the given joint names."""
    parts = ['<robot name="arm"><link name="link_0"/>']
    for n, (name, (a, alpha, d)) in enumerate(zip(joints, ARMS[arm]), 1):
        xyz = f'{a} {-math.sin(alpha) * d} {math.cos(alpha) * d}'
        parts.append(
            f'<link name="link_{n}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" '
            f'izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="link_{n - 1}"/>'
            f'<child link="link_{n}"/><origin xyz="{xyz}" rpy="{alpha} 0 0"/><axis xyz="0 0 1"/>'
            f'<limit lower="-6.3" upper="6.3" effort="400" velocity="4"/></joint>')
    return ''.join([*parts, '</robot>'])
