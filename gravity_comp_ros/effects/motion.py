"""Motion of a recording: quantities from which effect columns are computed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import direction, min_speeds, path_of, speed_noise
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np
from numpy.typing import NDArray

Gradient = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Motion:
    """
    Quantities from which effect columns are computed.

    - `samples`: measured q, qd and tau of all runs.
    - `qdd` (M, N) in rad/s^2: estimated acceleration.
    - `gravity` (M, N) in N·m: torque predicted by the gravity model.
    - `gravity_gradient`: function of poses (M, N) that returns d gravity_n / d q_j (M, N, N) in
      N·m/rad.
    - `chain`: the serial arm fitted to gravity, if there is one; `geometry`: its axes and lengths,
      if a robot description gives them.
    - `memo`: cache of results that do not depend on gravity.
    """

    samples: JointSamples
    qdd: FloatArray
    gravity: FloatArray
    gravity_gradient: Gradient
    chain: Chain | None = None
    geometry: Geometry | None = None
    memo: dict[object, NDArray[Any]] = field(default_factory=dict, repr=False, compare=False)
    of_gravity: dict[object, FloatArray] = field(default_factory=dict, init=False, repr=False,
                                                 compare=False)

    @classmethod
    def of(cls, samples: JointSamples, gravity: FloatArray, gravity_gradient: Gradient,
           chain: Chain | None = None, geometry: Geometry | None = None) -> Motion:
        """Return the motion of samples with the gravity torque (M, N) of a model."""
        return cls(samples, accelerations(samples), gravity, gravity_gradient, chain, geometry)

    def with_gravity(self, gravity: FloatArray, gravity_gradient: Gradient,
                     chain: Chain | None = None, geometry: Geometry | None = None) -> Motion:
        """Return the same motion with another gravity torque (M, N)."""
        return replace(self, gravity=gravity, gravity_gradient=gravity_gradient, chain=chain,
                       geometry=geometry)

    @property
    def gradient(self) -> FloatArray:
        """Return d gravity_n / d q_j (M, N, N) in N·m/rad, computed on demand."""
        if 'gradient' not in self.of_gravity:
            self.of_gravity['gradient'] = self.gravity_gradient(self.samples.q)
        return self.of_gravity['gradient']

    @property
    def speed_noise(self) -> FloatArray:
        """Return the standard deviation (N,) of the white noise of the speeds, rad/s."""
        if 'speed noise' not in self.memo:
            self.memo['speed noise'] = speed_noise(self.samples)
        return self.memo['speed noise']

    def min_speed(self, joint: int) -> float:
        """Return the speed in rad/s above which the direction of a joint is certain."""
        return float(min_speeds(self.speed_noise[joint]))

    def direction(self, joint: int, law: Mapping[str, float]) -> FloatArray:
        """Return the direction of a joint's friction, (M,), from -1 to 1 (`motion_direction`)."""
        return self.coupled_direction({joint: 1.0}, law)

    def coupled_direction(self, joints: Mapping[int, float],
                          law: Mapping[str, float]) -> FloatArray:
        """Return the direction (M,) of a sum of joints, each times a factor."""
        key = (tuple(joints.items()), tuple(law.items()))
        if key not in self.memo:
            qd = self._sum(self.samples.qd, joints)
            path = self.path(joints) if 'distance' in law else qd
            self.memo[key] = direction(self.samples, path, qd, law)
        return self.memo[key]

    def path(self, joints: Mapping[int, float]) -> FloatArray:
        """Return the denoised angle (M,) in rad of a sum of joints."""
        key = ('path', tuple(joints.items()))
        if key not in self.memo:
            self.memo[key] = path_of(self.samples, self._sum(self.samples.q, joints))
        return self.memo[key]

    @staticmethod
    def _sum(values: FloatArray, joints: Mapping[int, float]) -> FloatArray:
        return np.asarray(sum(factor * values[:, joint] for joint, factor in joints.items()))
