"""Figures of the paper: measured and predicted torque over time, and the friction test."""

from __future__ import annotations

from bench.paper.friction import Check
from bench.paper.methods import Fitted
from bench.paper.scenes import Scene
from bench.paper.svg import Panel, plot
import numpy as np


def torques(scene: Scene, methods: dict[str, Fitted], joints: tuple[int, ...],
            rate: float) -> str:
    """Plot measured and predicted torque of some joints on the test motion."""
    t = np.arange(len(scene.inside.q)) / rate
    panels = []
    for joint in joints:
        lines = [('measured', t, scene.inside.measured[:, joint])]
        lines += [(name, t, fitted.predict(scene.inside.q)[:, joint])
                  for name, fitted in methods.items()]
        panels.append(Panel(f'J{joint + 1}', lines))
    return plot(panels, 'time in s', 'torque in N·m')


def sweeps(checks: list[Check]) -> str:
    """Plot the torque of slow motion in both directions and the torque at rest."""
    panels = [Panel(f'J{c.joint + 1}', [('at rest', c.q, c.static), ('forward', c.q, c.forward),
                                        ('reverse', c.q, c.reverse)]) for c in checks]
    return plot(panels, 'angle in rad', 'torque in N·m')
