"""
Gravity and dynamics of a serial arm whose axes, moments, lengths and inertias are estimated.

Gravity is that of a `Chain`: axes A_i and first moments h_i. Let p_i be the origin of frame i + 1
in link i, and I_i the inertia of link i about the origin of its frame, with the masses beyond it
concentrated at the end of the link. With b_i = R_i h_i / g, in the base frame, the kinetic energy
is (J. Wittenburg, Dynamics of Systems of Rigid Bodies, 1977: augmented bodies)

    T = sum_{i < k} d(R_i p_i)/dt . d b_k/dt + 1/2 sum_i w_i . R_i I_i R_i' w_i,

so that the torque of motion is linear in p_i and I_i for given axes and moments. Slow motion
determines few of them; the others stay at their prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.arm_columns import motion_columns, motion_torque
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.regression.scale import Scale
from gravity_comp_ros.regression.shared import Shared, State
import numpy as np

# Largest rotation of an axis in one step, in rad.
_MAX_STEP = 0.2
# Rotation in rad of a finite difference.
_DIFFERENCE = 1e-6


@dataclass(frozen=True)
class LengthPriors:
    """
    Prior standard deviations of an arm without a description.

    `tilt` in rad of an axis about its present estimate; `moment` as a multiple of the largest
    torque; `length` in m of a link; `inertia` in m, times the largest torque over g: the inertia
    about a joint of the mass beyond it, at the reach of the arm.
    """

    tilt: float = 0.3
    moment: float = 2.0
    length: float = 0.5
    inertia: float = 0.7


@dataclass(frozen=True, eq=False)
class UnknownLengths(Shared):
    """
    A chain with unknown lengths: 2N tilts, 2N moments, 3(N - 1) lengths, 6N inertias.

    `lengths` (N - 1, 3) in m, `inertias` (N, 6) in kg·m^2: xx, yy, zz, xy, xz, yz of each link.
    `carried` (N, 2) are the moments in the torque of motion. They are renewed between linearised
    problems (`renewed`): the product of moments and lengths would not be linear.
    """

    chain: Chain
    lengths: FloatArray
    inertias: FloatArray
    carried: FloatArray
    priors: LengthPriors = LengthPriors()

    @classmethod
    def of(cls, chain: Chain, lengths: FloatArray | None = None,
           inertias: FloatArray | None = None) -> UnknownLengths:
        """Return a chain with lengths and inertias of 0, the mean of their prior, by default."""
        n = chain.n_joints
        if lengths is not None and inertias is not None:
            return cls(chain, lengths, inertias, chain.moments)
        return cls(chain, np.zeros((n - 1, 3)), np.zeros((n, 6)), chain.moments)

    @property
    def point(self) -> FloatArray:
        n = self.chain.n_joints
        return np.concatenate([np.zeros(2 * n), self.chain.moments.ravel(), self.lengths.ravel(),
                               self.inertias.ravel()])

    @property
    def n_angles(self) -> int:
        return 2 * self.chain.n_joints

    def step_map(self) -> FloatArray:
        """Return the step of the chain per parameter, (4N, P)."""
        return np.eye(4 * self.chain.n_joints, len(self.point))

    def prior_std(self, scale: Scale) -> FloatArray:
        n, p = self.chain.n_joints, self.priors
        return np.concatenate([
            np.full(2 * n, p.tilt), np.full(2 * n, p.moment * scale.largest),
            np.full(3 * (n - 1), p.length),
            np.full(6 * n, p.inertia * scale.largest / STANDARD_GRAVITY)])

    def columns(self, state: State) -> FloatArray:
        n, m = self.chain.n_joints, len(state.q)
        columns = np.zeros((m, n, 13 * n - 3))
        columns[:, :, :4 * n] = self.chain.jacobian(state.q).transpose(2, 1, 0)
        if not state.still:
            columns[:, :, 4 * n:] = motion_columns(
                Chain(self.chain.axes, self.carried), state.q, state.qd, state.qdd)
            columns[:, :, :2 * n] += self._motion_by_tilts(state)
        return columns

    def torque(self, state: State) -> FloatArray:
        return self.chain.torque(state.q) + self._motion(self.chain, state)

    def _motion(self, chain: Chain, state: State) -> FloatArray:
        if state.still or not (self.lengths.any() or self.inertias.any()):
            return np.zeros_like(state.q)
        return motion_torque(Chain(chain.axes, self.carried), self.lengths, self.inertias,
                             state.q, state.qd, state.qdd)

    def renewed(self) -> UnknownLengths:
        return replace(self, carried=self.chain.moments)

    def _motion_by_tilts(self, state: State) -> FloatArray:
        """
        Return d torque of motion / d tilts (B, N, 2N).

        Some tilts do not change gravity, such as that about the vertical of the second axis; only
        motion determines them.
        """
        n = self.chain.n_joints
        result = np.zeros((len(state.q), n, 2 * n))
        if not (self.lengths.any() or self.inertias.any()):
            return result
        torque = self._motion(self.chain, state)
        for k in range(2 * n):
            step = np.zeros(4 * n)
            step[k] = _DIFFERENCE
            result[:, :, k] = (self._motion(self.chain.moved(step), state) - torque) / _DIFFERENCE
        return result

    def gravity(self, q: FloatArray) -> FloatArray:
        return self.chain.torque(q)

    def moved(self, parameters: FloatArray) -> UnknownLengths:
        n = self.chain.n_joints
        step = np.concatenate([np.clip(parameters[:2 * n], -_MAX_STEP, _MAX_STEP),
                               parameters[2 * n:4 * n] - self.chain.moments.ravel()])
        return replace(self, chain=self.chain.moved(step),
                       lengths=parameters[4 * n:7 * n - 3].reshape(n - 1, 3),
                       inertias=parameters[7 * n - 3:].reshape(n, 6))
