"""
Gravity on a support of the dictionary (Yu 2022, Eqs. 3-7), which ADMM selected.

`Energy` is one potential energy for all joints, `Torques` a sum for each joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion, torque_of
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.regression.prior import Prior, Scale
from gravity_comp_ros.regression.shared import Shared, State
import numpy as np

# Prior standard deviation of a weight as a multiple of the largest torque.
_WEIGHT = 3.0


@dataclass(frozen=True, eq=False)
class Energy(Shared):
    """The weights of a potential energy in J."""

    energy: Expansion

    @property
    def point(self) -> FloatArray:
        return self.energy.weights

    def prior(self, scale: Scale) -> Prior:
        return Prior.independent(0.0 * self.point, np.full(len(self.point),
                                                           _WEIGHT * scale.largest))

    def columns(self, state: State) -> FloatArray:
        design = EnergyDesign(state.q, np.ones(state.q.shape))
        return design.columns(self.energy.indices).reshape(
            state.q.shape[1], len(state.q), -1).transpose(1, 0, 2)

    def gravity(self, q: FloatArray) -> FloatArray:
        n = q.shape[1]
        return torque_of([self.energy.gradient(n, joint) for joint in range(n)], q)

    def moved(self, parameters: FloatArray) -> Energy:
        return replace(self, energy=Expansion(self.energy.indices, parameters))


@dataclass(frozen=True, eq=False)
class Torques(Shared):
    """The weights of the torques of all joints in N·m, joint by joint."""

    torques: tuple[Expansion, ...]

    @property
    def point(self) -> FloatArray:
        return np.concatenate([np.zeros(0), *(torque.weights for torque in self.torques)])

    def prior(self, scale: Scale) -> Prior:
        return Prior.independent(0.0 * self.point, np.full(len(self.point),
                                                           _WEIGHT * scale.largest))

    def columns(self, state: State) -> FloatArray:
        columns, start = np.zeros((*state.q.shape, len(self.point))), 0
        for joint, torque in enumerate(self.torques):
            here = slice(start, start + len(torque.indices))
            columns[:, joint, here] = dictionary.columns(state.q, torque.indices)
            start = here.stop
        return columns

    def gravity(self, q: FloatArray) -> FloatArray:
        return torque_of(self.torques, q)

    def moved(self, parameters: FloatArray) -> Torques:
        torques, start = [], 0
        for torque in self.torques:
            end = start + len(torque.indices)
            torques.append(Expansion(torque.indices, parameters[start:end]))
            start = end
        return replace(self, torques=tuple(torques))
