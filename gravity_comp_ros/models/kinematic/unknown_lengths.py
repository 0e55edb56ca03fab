"""
The torque of motion of a serial arm whose axes and moments gravity shows, but not its lengths.

Let p_i be where axis i lies in link i-1, and h_j the first moment of link j with all that it
carries, counted at the origin of its frame. Origins can be shifted along their own axes, so that
h_j is across the axis: it is the moment of the chain (`chain`). A mass beyond link j lies at
p_1 + ... + p_j and something within link j, so that the kinetic energy is

    T = sum_{i <= j} d(R_{i-1} p_i)/dt . d(R_j h_j)/dt + 1/2 sum_j w_j . I_j w_j,

I_j the inertia of link j about the origin of its frame with all that it carries, each mass of
that at the end of the link. The products p_i h_j are those of an arm of augmented bodies
(J. Wittenburg, Dynamics of Systems of Rigid Bodies, 1977). With h_j from gravity T is linear in
the lengths p_i and the inertias I_j, and so is the torque

    tau_n = sum_{i <= j} (z_n x u_i) . w_j'' + (z_n x w_j) . u_i'' + ...,  u_i = R_{i-1} p_i,
    w_j = R_j h_j,

where z_n x v stands for dv/dq_n, which is 0 if v does not turn with joint n.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
import numpy as np

# Of each link but the first, which turns about one axis: Iyy acts as Ixx and the inertia of the
# link before (M. Gautier, W. Khalil, IEEE Trans. Robotics and Automation 6, 1990).
INERTIAS = ('Ixx', 'Ixy', 'Ixz', 'Iyz', 'Izz')
_PLACES = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2))
# Samples whose columns are computed at once: they fit into the cache of a processor.
_AT_ONCE = 2048


def motion_columns(chain: Chain, balls: FloatArray, q: FloatArray, qd: FloatArray,
                   qdd: FloatArray) -> FloatArray:
    """
    Return the torque of a nominal arm and d tau / d parameters (M, N, 2 + 8 (N - 1)).

    The torque of the nominal arm is the first column. Then come inertias in kg·m^2, Izz of
    link 1, `INERTIAS` of link 2 and so on; then lengths in m, x, y and z of axis 2, of axis 3 and
    so on.

    :param chain: the gravity of the arm.
    :param balls: (N,) kg·m^2; the nominal arm has no lengths, and a ball of this inertia on each
        link.
    :param q: (M, N) rad; `qd` in rad/s and `qdd` in rad/s^2 alike.
    """
    moments = chain.moments / STANDARD_GRAVITY
    parts = [_columns(chain.axes, moments, balls, q[rows], qd[rows], qdd[rows])
             for rows in (slice(start, start + _AT_ONCE)
                          for start in range(0, max(len(q), 1), _AT_ONCE))]
    return np.ascontiguousarray(np.concatenate(parts, axis=2).transpose(2, 1, 0))


def product_columns(chain: Chain, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """
    Return d tau / d products (M, N, 2) of two parallel vertical first axes, per kg·m^2.

    Gravity does not show the moment h_2 about the second axis. The torque of motion has it times
    the length p_2 between the two: the part of the product along their common perpendicular and
    the part across it.
    """
    n = chain.n_joints
    moments = np.zeros((n, 2))
    moments[1, 0] = STANDARD_GRAVITY
    lengths = 2 + len(INERTIAS) * (n - 1)
    every = motion_columns(Chain(chain.axes, moments), np.zeros(n), q, qd, qdd)
    return every[:, :, lengths:lengths + 2]


def _columns(axes: FloatArray, moments: FloatArray, balls: FloatArray, q: FloatArray,
             qd: FloatArray, qdd: FloatArray) -> FloatArray:
    frames = ForwardKinematics(axes, q).turned
    motion = _Motion.of(frames[:, 2], qd, qdd)
    return np.concatenate([_of_balls(balls, motion)[None], _of_inertias(frames, motion),
                           _of_lengths(frames, moments, motion)])


@dataclass(frozen=True, eq=False)
class _Motion:
    """Axes, angular velocities and accelerations of all links in the base, (N, 3, M)."""

    z: FloatArray
    omega: FloatArray
    alpha: FloatArray

    @classmethod
    def of(cls, z: FloatArray, qd: FloatArray, qdd: FloatArray) -> _Motion:
        omega, alpha = np.empty_like(z), np.empty_like(z)
        before, turning = np.zeros_like(z[0]), np.zeros_like(z[0])
        for n, axis in enumerate(z):
            spin = axis * qd[:, n]
            turning = turning + axis * qdd[:, n] + _cross(before, spin)
            before = before + spin
            omega[n], alpha[n] = before, turning
        return cls(z, omega, alpha)

    def acceleration(self, link: int, v: FloatArray) -> FloatArray:
        """Return the second derivative of vectors (..., 3, M) that turn with a link."""
        omega, alpha = self.omega[link], self.alpha[link]
        return _cross(alpha, v) + _cross(omega, _cross(omega, v))


def _of_balls(balls: FloatArray, motion: _Motion) -> FloatArray:
    """Return the torque (N, M) of balls, which resist angular acceleration alone."""
    beyond = np.cumsum((balls[:, None, None] * motion.alpha)[::-1], axis=0)[::-1]
    return _dot(motion.z, beyond)


def _of_lengths(frames: FloatArray, moments: FloatArray, motion: _Motion) -> FloatArray:
    """Return the columns (3 (N - 1), N, M) of where axes lie."""
    n, m = len(frames), frames.shape[3]
    own = moments[:, 0, None, None] * frames[:, 0] + moments[:, 1, None, None] * frames[:, 1]
    # From link j outwards: S_j, and how it accelerates.
    beyond = np.cumsum(own[::-1], axis=0)[::-1]
    pulled = np.cumsum(np.stack([motion.acceleration(j, own[j])
                                 for j in reversed(range(n))]), axis=0)[::-1]
    lever = _cross(motion.z, beyond)
    found = np.zeros((n - 1, 3, n, m))
    for i in range(n - 1):
        u = frames[i]
        accelerated = motion.acceleration(i, u)
        for joint in range(n):
            if joint <= i:
                found[i, :, joint] = _dot(_cross(motion.z[joint], u), pulled[i + 1])
                moved = _cross(motion.z[joint], beyond[i + 1])
            else:
                moved = lever[joint]
            found[i, :, joint] += _dot(moved, accelerated)
    return found.reshape(-1, n, m)


def _of_inertias(frames: FloatArray, motion: _Motion) -> FloatArray:
    """Return the columns (1 + 5 (N - 1), N, M) of inertias."""
    n, m = len(frames), frames.shape[3]
    found = np.zeros((n, len(INERTIAS), n, m))
    for link, axes in enumerate(frames):
        omega, alpha = _dot(axes, motion.omega[link]), _dot(axes, motion.alpha[link])
        for k, (row, column) in enumerate(_PLACES):
            moment = _times(row, column, alpha) + _cross(omega, _times(row, column, omega))
            in_base = np.einsum('acm,am->cm', axes, moment)
            found[link, k, :link + 1] = _dot(motion.z[:link + 1], in_base)
    return found.reshape(-1, n, m)[len(INERTIAS) - 1:]


def _times(row: int, column: int, v: FloatArray) -> FloatArray:
    """Return I v (3, M) of the inertia with 1 at a place and opposite it."""
    found = np.zeros_like(v)
    found[row] = v[column]
    if row != column:
        found[column] = v[row]
    return found


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b of vectors (..., 3, M)."""
    x, y, z = (a[..., k, :] for k in range(3))
    u, v, w = (b[..., k, :] for k in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-2)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a . b (..., M) of vectors (..., 3, M)."""
    return np.asarray((a * b).sum(axis=-2))
