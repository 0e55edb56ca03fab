"""
Dynamic torque of a serial arm with known axes and moments (from gravity) and unknown lengths.

Let p_i be the origin of frame i in link i-1, and h_j the first moment about the origin of frame j
of link j and all links beyond it. Origins can be shifted along their own axes so that h_j is
perpendicular to the axis: it is the moment of the chain (`chain`). A mass of link j lies at
p_1 + ... + p_j plus its position within link j, so the kinetic energy is

    T = sum_{i <= j} d(R_{i-1} p_i)/dt . d(R_j h_j)/dt + 1/2 sum_j w_j . I_j w_j,

I_j the inertia of link j about the origin of its frame, with the masses of all links beyond it
concentrated at the end of the link. The products p_i h_j are those of an arm of augmented bodies
(J. Wittenburg, Dynamics of Systems of Rigid Bodies, 1977). With h_j from gravity, T is linear in
the lengths p_i and the inertias I_j, and so is the torque

    tau_n = sum_{i <= j} (z_n x u_i) . w_j'' + (z_n x w_j) . u_i'' + ...,  u_i = R_{i-1} p_i,
    w_j = R_j h_j,

where z_n x v is dv/dq_n, which is 0 if v does not rotate with joint n.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
import numpy as np

# Inertias of each link but the first, which has Izz only. Iyy is grouped into Ixx and the inertia
# of the link before (M. Gautier, W. Khalil, IEEE Trans. Robotics and Automation 6, 1990).
INERTIAS = ('Ixx', 'Ixy', 'Ixz', 'Iyz', 'Izz')
_PLACES = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2))
# Number of samples per batch: their columns fit into the processor's cache.
_AT_ONCE = 2048


def motion_columns(chain: Chain, balls: FloatArray, q: FloatArray, qd: FloatArray,
                   qdd: FloatArray) -> FloatArray:
    """
    Return the torque of a nominal arm and d tau / d parameters (M, N, 2 + 8 (N - 1)).

    The first column is the torque of the nominal arm. The next are inertias in kg·m^2, Izz of
    link 1, `INERTIAS` of link 2 and so on; then lengths in m, x, y and z of axis 2, of axis 3 and
    so on.

    :param chain: the gravity of the arm.
    :param balls: (N,) kg·m^2; the nominal arm has no lengths, and a ball of this inertia on each
        link.
    :param q: (M, N) rad; `qd` in rad/s and `qdd` in rad/s^2.
    """
    moments = chain.moments / STANDARD_GRAVITY
    parts = [_columns(chain.axes, moments, balls, q[rows], qd[rows], qdd[rows])
             for rows in (slice(start, start + _AT_ONCE)
                          for start in range(0, max(len(q), 1), _AT_ONCE))]
    return np.ascontiguousarray(np.concatenate(parts, axis=2).transpose(2, 1, 0))


def product_columns(chain: Chain, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """
    Return d tau / d products (M, N, 2) of two parallel vertical first axes, per kg·m^2.

    The moment h_2 about the second axis has no gravity torque. The dynamic torque contains its
    product with the length p_2 between the two axes: one component along their common normal and
    one perpendicular to it.
    """
    n = chain.n_joints
    moments = np.zeros((n, 2))
    moments[1, 0] = STANDARD_GRAVITY
    lengths = 2 + len(INERTIAS) * (n - 1)
    columns = motion_columns(Chain(chain.axes, moments), np.zeros(n), q, qd, qdd)
    return columns[:, :, lengths:lengths + 2]


def _columns(axes: FloatArray, moments: FloatArray, balls: FloatArray, q: FloatArray,
             qd: FloatArray, qdd: FloatArray) -> FloatArray:
    frames = ForwardKinematics(axes, q).rotated
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
        velocity, acceleration = np.zeros_like(z[0]), np.zeros_like(z[0])
        for n, axis in enumerate(z):
            spin = axis * qd[:, n]
            acceleration = acceleration + axis * qdd[:, n] + _cross(velocity, spin)
            velocity = velocity + spin
            omega[n], alpha[n] = velocity, acceleration
        return cls(z, omega, alpha)

    def acceleration(self, link: int, v: FloatArray) -> FloatArray:
        """Return the second derivative of vectors (..., 3, M) fixed to a link."""
        omega, alpha = self.omega[link], self.alpha[link]
        return _cross(alpha, v) + _cross(omega, _cross(omega, v))


def _of_balls(balls: FloatArray, motion: _Motion) -> FloatArray:
    """Return the torque (N, M) of balls, whose inertia has no gyroscopic torque."""
    beyond = np.cumsum((balls[:, None, None] * motion.alpha)[::-1], axis=0)[::-1]
    return _dot(motion.z, beyond)


def _of_lengths(frames: FloatArray, moments: FloatArray, motion: _Motion) -> FloatArray:
    """Return the columns (3 (N - 1), N, M) of the lengths p_i."""
    n, m = len(frames), frames.shape[3]
    own = moments[:, 0, None, None] * frames[:, 0] + moments[:, 1, None, None] * frames[:, 1]
    # The sum S_j of moments from link j outwards, and its second derivative.
    beyond = np.cumsum(own[::-1], axis=0)[::-1]
    beyond_acceleration = np.cumsum(np.stack([motion.acceleration(j, own[j])
                                              for j in reversed(range(n))]), axis=0)[::-1]
    lever = _cross(motion.z, beyond)
    columns = np.zeros((n - 1, 3, n, m))
    for i in range(n - 1):
        u = frames[i]
        acceleration = motion.acceleration(i, u)
        for joint in range(n):
            if joint <= i:
                columns[i, :, joint] = _dot(_cross(motion.z[joint], u),
                                            beyond_acceleration[i + 1])
                derivative = _cross(motion.z[joint], beyond[i + 1])
            else:
                derivative = lever[joint]
            columns[i, :, joint] += _dot(derivative, acceleration)
    return columns.reshape(-1, n, m)


def _of_inertias(frames: FloatArray, motion: _Motion) -> FloatArray:
    """Return the columns (1 + 5 (N - 1), N, M) of inertias."""
    n, m = len(frames), frames.shape[3]
    columns = np.zeros((n, len(INERTIAS), n, m))
    for link, axes in enumerate(frames):
        omega, alpha = _dot(axes, motion.omega[link]), _dot(axes, motion.alpha[link])
        for k, (row, column) in enumerate(_PLACES):
            moment = _times(row, column, alpha) + _cross(omega, _times(row, column, omega))
            in_base = np.einsum('acm,am->cm', axes, moment)
            columns[link, k, :link + 1] = _dot(motion.z[:link + 1], in_base)
    return columns.reshape(-1, n, m)[len(INERTIAS) - 1:]


def _times(row: int, column: int, v: FloatArray) -> FloatArray:
    """Return I v (3, M) of the symmetric inertia with one unit element and its transpose."""
    result = np.zeros_like(v)
    result[row] = v[column]
    if row != column:
        result[column] = v[row]
    return result


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b of vectors (..., 3, M)."""
    x, y, z = (a[..., k, :] for k in range(3))
    u, v, w = (b[..., k, :] for k in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-2)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a . b (..., M) of vectors (..., 3, M)."""
    return np.asarray((a * b).sum(axis=-2))
