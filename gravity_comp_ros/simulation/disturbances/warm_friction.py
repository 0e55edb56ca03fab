"""Friction that warms its gear, and falls as the gear warms."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm
from gravity_comp_ros.simulation.disturbances.changed import check_joint, with_torque
from gravity_comp_ros.simulation.disturbances.grid import fine
from gravity_comp_ros.simulation.disturbances.lugre import friction_torque, LuGre
from gravity_comp_ros.simulation.motions import Motion
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Vogel's law of a synthetic gear oil: viscosity ~ exp(B / (T - T0)), T in degrees Celsius.
VOGEL_B = 900.0
VOGEL_T0 = -95.0


@dataclass(frozen=True)
class WarmFriction:
    """
    LuGre friction in a gear with a temperature T, in degrees Celsius, that starts at `begin`.

        capacity dT/dt = idle + |friction * qd| - (T - room) / resistance

    `resistance` in K/W and `capacity` in J/K give the time resistance * capacity in which the
    gear warms; `idle` W come from motor and brake. The viscous coefficient follows Vogel's law
    of its oil; the bristles' force falls by the fraction `softening` a kelvin, down to a fifth.
    Without `begin` the gear starts at the temperature of the room.
    """

    joint: int
    surfaces: LuGre
    idle: float = 3.0
    resistance: float = 6.0
    capacity: float = 12.0
    softening: float = 0.015
    room: float = 22.0
    begin: float | None = None

    def __post_init__(self) -> None:
        for field in ('resistance', 'capacity'):
            if not getattr(self, field) > 0:
                raise OptionError(f'warm friction: {field} must be positive')

    def dry_factor(self, temperature: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(1 - self.softening * (temperature - self.room), 0.2))

    def viscosity_factor(self, temperature: FloatArray) -> FloatArray:
        cold = VOGEL_B / (self.room - VOGEL_T0)
        return np.asarray(np.exp(VOGEL_B / (temperature - VOGEL_T0) - cold))

    def temperature(self, t: FloatArray, cold_power: FloatArray) -> FloatArray:
        """
        Return T (K,) at times t (K,) in s.

        :param cold_power: |friction * qd| (K,) in W as it would be at room temperature; it is
            scaled by how far dry friction has fallen.
        """
        keep = np.exp(-np.diff(t) / (self.resistance * self.capacity))
        state = self.room if self.begin is None else self.begin
        out = [state]
        for power, k in zip(cold_power.tolist(), keep.tolist()):
            fall = max(1 - self.softening * (state - self.room), 0.2)
            target = self.room + self.resistance * (self.idle + fall * power)
            state = target + (state - target) * k
            out.append(state)
        return np.array(out)

    def apply(self, signals: Signals, motion: Motion, arm: Arm,
              rng: np.random.Generator) -> Signals:
        check_joint(self.joint, arm)
        grid = fine(motion)
        v = grid.qd[:, self.joint]
        cold = friction_torque(grid.t, grid.q[:, self.joint], v, self.surfaces)
        warm = self.temperature(grid.t, np.abs(cold * v))
        oil = self.surfaces.viscous * v
        torque = self.dry_factor(warm) * (cold - oil) + self.viscosity_factor(warm) * oil
        return with_torque(signals, self.joint, torque[grid.at])
