"""The gravity torque of a described arm with assumed faults of its description."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.kinematic.chain import Chain
import numpy as np


@dataclass(frozen=True, eq=False)
class ArmState:
    """
    A serial arm of N joints, as the recording reports it.

    `rotations`, `origins` as in `Geometry`; `bodies` (N, 4) are mass in kg and first moment in
    kg m of all links of each frame. The true angle of axis i is `signs` times the recorded one
    plus `zeros` in rad; its torque is recorded with the factor `gains`, and with its sign.
    `order` (N,) is the column of the recording that belongs to axis i.
    """

    rotations: FloatArray
    origins: FloatArray
    bodies: FloatArray
    signs: FloatArray
    zeros: FloatArray
    gains: FloatArray
    order: IntArray

    @classmethod
    def described(cls, rotations: FloatArray, origins: FloatArray,
                  bodies: FloatArray) -> ArmState:
        """Return the arm as described."""
        n = len(rotations)
        return cls(rotations, origins, bodies, np.ones(n), np.zeros(n), np.ones(n), np.arange(n))

    def angles(self, q: FloatArray) -> FloatArray:
        """Return the angles (M, N) of the axes from recorded ones, rad."""
        return np.asarray(self.signs * q[:, self.order] + self.zeros)

    def recorded(self, torque: FloatArray) -> FloatArray:
        """Return the torque (M, N) as recorded, from that about the axes."""
        result = np.empty_like(torque)
        result[:, self.order] = self.signs * self.gains * torque
        return result

    def gravity(self, q: FloatArray) -> FloatArray:
        """Return the recorded gravity torque (M, N) in N·m at recorded angles (M, N)."""
        return self.recorded(self.chain().torque(self.angles(q)))

    def chain(self) -> Chain:
        """Return the chain: every link carries those beyond it at the end of its length."""
        n, moments = len(self.bodies), self.bodies[:, 1:].copy()
        beyond = np.concatenate([np.cumsum(self.bodies[::-1, 0])[::-1][1:], [0.0]])
        moments[:-1] += beyond[:-1, None] * self.origins[1:]
        for i in range(n - 1, 0, -1):
            # A moment along an axis acts as a moment of the link before.
            moments[i - 1] += moments[i, 2] * self.rotations[i][:, 2]
        return Chain(self.rotations, STANDARD_GRAVITY * moments[:, :2])

    def turned_axis(self, joint: int, turn: FloatArray) -> ArmState:
        """Return the arm with the axis of a joint turned by a rotation (3, 3) of its frame."""
        rotations, origins, bodies = (self.rotations.copy(), self.origins.copy(),
                                      self.bodies.copy())
        rotations[joint] = rotations[joint] @ turn
        # At angle 0 the links stay where they are.
        bodies[joint, 1:] = turn.T @ bodies[joint, 1:]
        if joint + 1 < len(rotations):
            rotations[joint + 1] = turn.T @ rotations[joint + 1]
            origins[joint + 1] = turn.T @ origins[joint + 1]
        return replace(self, rotations=rotations, origins=origins, bodies=bodies)

    def turned_base(self, turn: FloatArray) -> ArmState:
        """Return the arm with its base turned by a rotation (3, 3)."""
        rotations = self.rotations.copy()
        rotations[0] = turn @ rotations[0]
        return replace(self, rotations=rotations)

    def with_body(self, joint: int, change: FloatArray) -> ArmState:
        """Return the arm with mass and first moment (4,) added to a frame."""
        bodies = self.bodies.copy()
        bodies[joint] = bodies[joint] + change
        return replace(self, bodies=bodies)
