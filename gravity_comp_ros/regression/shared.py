"""
Columns shared by all joints: gravity and rigid-body dynamics, linearised at the present estimate.

    torque(x; theta) = torque(x; theta_0) + C(x; theta_0) (theta - theta_0)

Four parametrisations: `UnknownLengths` (a chain whose axes are estimated), `KnownAxes` (a robot
description), `Energy` and `Torques` (the dictionary of Yu 2022 on a support that ADMM selected).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.regression.prior import Prior, Scale
import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit


@dataclass(frozen=True, eq=False)
class State:
    """Angles, speeds and accelerations (B, N) in rad, rad/s and rad/s^2."""

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray

    @property
    def still(self) -> bool:
        """Return whether no joint moves, so that only gravity acts."""
        return not (self.qd.any() or self.qdd.any())

    def select(self, here: slice) -> State:
        """Return some of the states."""
        return State(self.q[here], self.qd[here], self.qdd[here])


class Shared(ABC):
    """A parametrisation of the torque of all joints, with P parameters."""

    @property
    @abstractmethod
    def point(self) -> FloatArray:
        """Return the parameters (P,) at which the columns are linearised; angles are 0 there."""

    @property
    def n_angles(self) -> int:
        """Return the number of leading parameters that are angles, in which it is not linear."""
        return 0

    def exact_std(self) -> FloatArray:
        """Return `mixture_std` of the angles that are exact, 0 of the others, (A,) in rad."""
        return np.zeros(self.n_angles)

    @abstractmethod
    def prior(self, scale: Scale) -> Prior:
        """Return the prior of the parameters; angles are 0 at the point."""

    @abstractmethod
    def columns(self, state: State) -> FloatArray:
        """Return d torque / d parameters (B, N, P) at the point."""

    @abstractmethod
    def gravity(self, q: FloatArray) -> FloatArray:
        """Return the gravity torque (B, N) in N·m at poses q (B, N)."""

    @abstractmethod
    def moved(self, parameters: FloatArray) -> Shared:
        """Return the same at other parameters (P,)."""

    def renewed(self) -> Shared:
        """Return the same with what is constant in a linearised problem at the estimate."""
        return self

    def with_exact_angles(self, covariance: FloatArray) -> Shared:
        """
        Return the same with the angles that are probably exact: right angles, described ones.

        :param covariance: (P, P) of the parameters.
        """
        return self

    def at_near_angles(self) -> Shared:
        """Return the same at the exact angles that are near."""
        return self

    def with_first_reversed(self) -> Shared:
        """Return the same with the first joint reversed, itself where gravity contradicts that."""
        return self

    def torque(self, state: State) -> FloatArray:
        """Return the torque (B, N) in N·m at the point."""
        return np.asarray(self.columns(state) @ self.point)

    def gradient(self, q: FloatArray) -> FloatArray:
        """Return d gravity_n / d q_j (B, N, N) in N·m/rad, by central differences."""
        n, step = q.shape[1], 1e-5
        result = np.empty((len(q), n, n))
        for joint in range(n):
            change = np.zeros(n)
            change[joint] = step
            result[:, :, joint] = (self.gravity(q + change) - self.gravity(q - change)) / (
                2.0 * step)
        return result


def mixture_std(gain: ArrayLike, step: FloatArray, variance: FloatArray) -> FloatArray:
    """
    Return the standard deviations (K,) in rad of angles about their exact value.

    They are those over both hypotheses. The free angle has the probability of its evidence.

    :param gain: log evidence in nats of the exact angle over the free one.
    :param step: difference (K,) in rad of the exact angle from the free one.
    :param variance: that (K,) of the free angle, in rad^2.
    """
    return np.asarray(np.sqrt(expit(-np.asarray(gain)) * (variance + step ** 2)))
