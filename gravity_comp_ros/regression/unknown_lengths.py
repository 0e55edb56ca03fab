"""
Gravity and dynamics of a serial arm whose axes, moments, lengths and inertias are estimated.

Gravity is that of a `Chain`: axes A_i and first moments h_i. Let p_i be the origin of frame i + 1
in link i, and I_i the inertia of link i about the origin of its frame, with the masses beyond it
concentrated at the end of the link. With b_i = R_i h_i / g, in the base frame, the kinetic energy
is (J. Wittenburg, Dynamics of Systems of Rigid Bodies, 1977: augmented bodies)

    T = sum_{i < k} d(R_i p_i)/dt . d b_k/dt + 1/2 sum_i w_i . R_i I_i R_i' w_i,

so that the torque of motion is linear in p_i and I_i for given axes and moments. Slow motion
determines few of them; the others stay at their prior.

Most axes are parallel or perpendicular to the one before, and the first to the vertical. Most
zero angles turn an axis by a multiple of 90 degrees. A tilt is a change of the former angle and
one across it, of the latter. `with_exact_angles` compares each of these hypotheses with a free
angle by their evidence (the ratio of Savage and Dickey).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.kinematic.arm_columns import (
    ArmMotion, motion_columns, motion_torque_by_tilts)
from gravity_comp_ros.models.kinematic.chain import about_z, Chain, tilt
from gravity_comp_ros.regression.prior import Prior, Scale
from gravity_comp_ros.regression.shared import mixture_std, Shared, State
import numpy as np
from scipy.linalg import block_diag

# Largest rotation of an axis in one step, in rad.
_MAX_STEP = 0.2
# Sine of the angle between axes above which a rotation about the first moves the second.
_MIN_SINE = 0.5


@dataclass(frozen=True)
class LengthPriors:
    """
    Priors of an arm without a description; standard deviations unless stated.

    `tilt` in rad of an axis about its present estimate: any direction is possible; `right` if its
    angle is exact; `moment` as a multiple of the largest torque; `length` in m of a link.

    A link with the masses beyond it is long: its inertia about axes across its first moment b is
    about |b| times `radius` in m, and about the moment 0. `inertia` in m times |b| is the
    deviation from this mean, `others` in m times the torque scale beyond over g that of links
    whose moment is along their axis, and `rotor` in s^2 times the joint's torque scale that of the
    inertia about the joint, which includes the reflected one of the rotor.

    `radius`, `inertia` and `others` are those of largest evidence on eight arms. `exact` is the
    log evidence in nats at which an angle is exact. That of an axis that the torque does not
    determine is near 0. `near` in rad is the distance from an exact angle up to which an effect
    may have turned the axis.
    """

    tilt: float = 1.0
    right: float = 1e-7
    moment: float = 2.0
    length: float = 0.2
    radius: float = 0.25
    inertia: float = 0.1
    others: float = 0.02
    rotor: float = 0.02
    exact: float = 1.0
    near: float = 0.15


@dataclass(frozen=True, eq=False)
class UnknownLengths(Shared):
    """
    A chain with unknown lengths: 2N tilts, 2N moments, 3(N - 1) lengths, 6N inertias.

    The tilts of an axis are those of `_turns`. `is_right` (2N,) are those that a right angle or a
    parallel axis fixes; `mixture_std` (2N,) is their `exact_std`.

    `lengths` (N - 1, 3) in m, `inertias` (N, 6) in kg·m^2: xx, yy, zz, xy, xz, yz of each link.
    `carried` (N, 2) are the moments in the torque of motion and in the prior of the inertias. They
    are renewed between linearised problems (`renewed`): the product of moments and lengths would
    not be linear.
    """

    chain: Chain
    lengths: FloatArray
    inertias: FloatArray
    carried: FloatArray
    is_right: BoolArray
    mixture_std: FloatArray
    priors: LengthPriors = LengthPriors()

    @classmethod
    def of(cls, chain: Chain, lengths: FloatArray | None = None,
           inertias: FloatArray | None = None) -> UnknownLengths:
        """Return a chain with lengths and inertias of 0, the mean of their prior, by default."""
        n = chain.n_joints
        return cls(chain, np.zeros((n - 1, 3)) if lengths is None else lengths,
                   np.zeros((n, 6)) if inertias is None else inertias, chain.moments,
                   np.zeros(2 * n, dtype=bool), np.zeros(2 * n))

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
        n = self.chain.n_joints
        result = np.eye(4 * n, len(self.point))
        result[:2 * n, :2 * n] = block_diag(*_turns(self.chain))
        return result

    def exact_std(self) -> FloatArray:
        return self.mixture_std

    def prior(self, scale: Scale) -> Prior:
        n, p, (size, (x, y)) = self.chain.n_joints, self.priors, self._moment()
        across = np.stack([y * y, x * x, np.ones_like(x), -x * y, 0 * x, 0 * x], axis=1)
        mean = np.concatenate([np.zeros(7 * n - 3), (p.radius * size[:, None] * across).ravel()])
        beyond = np.maximum.accumulate(scale.torque[::-1])[::-1] / STANDARD_GRAVITY
        inertia = np.repeat(p.others * beyond + p.inertia * size, 6)
        inertia[2::6] += p.rotor * scale.torque
        return Prior.independent(mean, np.concatenate([
            np.where(self.is_right, p.right, p.tilt), np.full(2 * n, p.moment * scale.largest),
            np.full(3 * (n - 1), p.length), inertia]))

    def _moment(self) -> tuple[FloatArray, FloatArray]:
        """Return size (N,) in kg·m and direction (2, N) of the first moments of the links."""
        size = np.linalg.norm(self.carried, axis=1)
        return size / STANDARD_GRAVITY, self.carried.T / np.maximum(size, 1e-9)

    def columns(self, state: State) -> FloatArray:
        n, m = self.chain.n_joints, len(state.q)
        columns, turns = np.zeros((n, 13 * n - 3, m)), block_diag(*_turns(self.chain)).T
        columns[:, :4 * n] = self.chain.jacobian(state.q).swapaxes(0, 1)
        columns[:, :2 * n] = turns @ columns[:, :2 * n]
        if not state.still:
            motion = ArmMotion.of(Chain(self.chain.axes, self.carried), state.q, state.qd,
                                  state.qdd)
            columns[:, 4 * n:] = motion_columns(motion)
            free = np.flatnonzero(~self.is_right)
            if free.size and (self.lengths.any() or self.inertias.any()):
                # Some tilts do not change gravity, such as that about the vertical of the second
                # axis; only motion determines them.
                columns[:, free] += turns[free] @ motion_torque_by_tilts(
                    motion, self.lengths, self.inertias, free // 2)
        return columns.transpose(2, 0, 1)

    def renewed(self) -> UnknownLengths:
        return replace(self, carried=self.chain.moments)

    def gravity(self, q: FloatArray) -> FloatArray:
        return self.chain.torque(q)

    def gradient(self, q: FloatArray) -> FloatArray:
        return self.chain.gradient(q)

    def moved(self, parameters: FloatArray) -> UnknownLengths:
        n = self.chain.n_joints
        tilts = np.clip(parameters[:2 * n], -_MAX_STEP, _MAX_STEP).reshape(n, 2, 1)
        step = np.concatenate([(_turns(self.chain) @ tilts).ravel(),
                               parameters[2 * n:4 * n] - self.chain.moments.ravel()])
        return replace(self, chain=self.chain.moved(step),
                       lengths=parameters[4 * n:7 * n - 3].reshape(n - 1, 3),
                       inertias=parameters[7 * n - 3:].reshape(n, 6))

    def with_exact_angles(self, covariance: FloatArray) -> UnknownLengths:
        std = self.mixture_std.copy()

        def is_exact(step: FloatArray, here: slice) -> bool:
            gain = self._gain(step, covariance[here, here])
            std[here] = mixture_std(gain, step, np.diag(covariance)[here])
            return gain > self.priors.exact

        exact = self._exact_where(is_exact)
        return self if exact is self else replace(
            exact, mixture_std=np.where(exact.is_right, std, 0.0))

    def at_near_angles(self) -> UnknownLengths:
        return self._exact_where(lambda step, here: bool(np.abs(step).max() < self.priors.near))

    def with_first_reversed(self) -> UnknownLengths:
        if np.hypot(*self.chain.axes[0, 2, :2]) > self.priors.near:
            return self
        chain = self.chain.with_first_reversed()
        return replace(self, chain=chain, carried=chain.moments,
                       lengths=0.0 * self.lengths, inertias=0.0 * self.inertias)

    def _exact_where(self, is_exact: Callable[[FloatArray, slice], bool]) -> UnknownLengths:
        """
        Return the same with exact angles.

        :param is_exact: decides on the step (K,) in rad to an exact angle, and its parameters.
        """
        axes, is_right = self.chain.axes.copy(), self.is_right.copy()
        for i, turn in enumerate(_turns(self.chain)):
            cosine, sine = axes[i, 2, 2], float(np.hypot(axes[i, 2, 0], axes[i, 2, 1]))
            parallel = sine < abs(cosine)
            here = slice(2 * i, 2 * i + 1 + parallel)
            # The tilt along `turn` that makes the axis parallel, or perpendicular.
            step = np.arctan2(np.sign(cosine) * sine, abs(cosine)) if parallel \
                else -np.arctan2(cosine, sine)
            if not is_right[here].any() and is_exact(
                    np.array([step, 0.0])[:here.stop - here.start], here):
                axes[i], is_right[here] = axes[i] @ tilt((turn[:, 0] * step)[None])[0], True
            before = np.hypot(axes[i - 1, 2, 0], axes[i - 1, 2, 1]) if i else 0.0
            if parallel or before < _MIN_SINE:
                continue
            azimuth = np.arctan2(axes[i, 1, 2], axes[i, 0, 2]) - np.arctan2(
                axes[i - 1, 2, 1], axes[i - 1, 2, 0])
            step = np.round(azimuth / (0.5 * np.pi)) * 0.5 * np.pi - azimuth
            across = slice(2 * i + 1, 2 * i + 2)
            if not is_right[across].any() and is_exact(np.array([step * sine]), across):
                axes[i], is_right[across] = about_z(step) @ axes[i], True
        if np.array_equal(is_right, self.is_right):
            return self
        return replace(self, chain=Chain(axes, self.chain.moments), is_right=is_right)

    def _gain(self, step: FloatArray, covariance: FloatArray) -> float:
        """Return the log evidence of tilts (K,) being exact rather than free."""
        spread = covariance + self.priors.right ** 2 * np.eye(len(step))
        return float(len(step) * np.log(self.priors.tilt) - 0.5 * np.linalg.slogdet(spread)[1]
                     - 0.5 * step @ np.linalg.solve(spread, step))


def _turns(chain: Chain) -> FloatArray:
    """
    Return the tilts (N, 2, 2) that a unit of each parameter is: along column 0 and across.

    Along it the angle to the axis before, or to the vertical, changes fastest.
    """
    along = np.stack([-chain.axes[:, 2, 1], chain.axes[:, 2, 0]], axis=1)
    size = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.where(size > 1e-9, along / np.maximum(size, 1e-9), np.array([1.0, 0.0]))
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([along, across], axis=2)
