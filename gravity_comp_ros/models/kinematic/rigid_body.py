"""
Rigid-body dynamics of a serial arm, linear in the inertial parameters of its links.

Frames are those of `Geometry`: frame i rotates with link i, its z is the axis of joint i. With
omega, alpha, p and a the angular velocity, the angular acceleration, the position and the
acceleration of the origin of frame i, the wrench on the link about the base is

    force  = m a + (alpha^ + omega^ omega^) (m c)
    moment = I alpha + omega^ I omega + (m c)^ a + p^ force,

I about the origin (recursive Newton-Euler; B. Siciliano, O. Khatib, Springer Handbook of
Robotics, ch. 3 and 6). The torque of joint j is that of the wrenches of all links from j outwards,
about its axis. All vectors are in coordinates of the base, so that every recursion over the joints
is a sum. Gravity is an acceleration of the base; without it the columns are those of the mass
matrix and of the centrifugal and Coriolis torque.

Not every parameter is identifiable, because a link rotates about one axis and carries the next.
Base parameters (M. Gautier, W. Khalil, IEEE Transactions on Robotics and Automation 6, 1990) are
the identifiable ones, with the others grouped into them.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.poses import batches
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

# Parameters of each link: mass, first moment and inertia about the origin of its frame.
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Ixz', 'Iyy', 'Iyz', 'Izz')
Pairs = tuple[tuple[int, int], ...]
_PAIRS: Pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """
    The moving links of N joints, vectors in the base at B states.

    `links` and `frames` (N, axis, xyz, B) are the axes of their frames after and before the
    rotation of their joint; `omega` and `alpha` (N, xyz, B) their angular velocities and
    accelerations.
    """

    links: FloatArray
    frames: FloatArray
    omega: FloatArray
    alpha: FloatArray

    @classmethod
    def on_axes(cls, rotations: FloatArray, q: FloatArray, qd: FloatArray,
                qdd: FloatArray) -> LinkMotion:
        """Return the motion at q (B, N) in rad, qd in rad/s and qdd in rad/s^2."""
        kinematics = ForwardKinematics(rotations, q)
        z = kinematics.frames[:, 2]
        speeds = z * qd.T[:, None]
        omega = np.cumsum(speeds, axis=0)
        alpha = np.cumsum(z * qdd.T[:, None] + cross(omega - speeds, speeds), axis=0)
        return LinkMotion(kinematics.rotated, kinematics.frames, omega, alpha)

    @property
    def z(self) -> FloatArray:
        """Return the axes of the joints, (N, xyz, B)."""
        return self.frames[:, 2]

    def accelerated(self, fixed: FloatArray) -> FloatArray:
        """
        Return the accelerations of vectors fixed in the first K links.

        It is alpha x v + omega (omega . v) - omega^2 v.

        :param fixed: (K, xyz, B), or several for each link, (K, L, xyz, B).
        """
        shape = (len(fixed), *[1] * (fixed.ndim - 3), *self.omega.shape[1:])
        omega, alpha = (rate[:len(fixed)].reshape(shape) for rate in (self.omega, self.alpha))
        square = dot(omega, omega)[..., None, :]
        return np.asarray(cross(alpha, fixed) + omega * dot(omega, fixed)[..., None, :]
                          - square * fixed)

    def origins(self, arms: FloatArray, gravity: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """
        Return positions and accelerations of the origins of all frames, (N, xyz, B).

        :param arms: the vectors (N - 1, xyz, B) between them. :param gravity: m/s^2.
        """
        end = np.zeros_like(self.omega[:1])
        position, a = (prefix_sums(np.concatenate([each, end]))
                       for each in (arms, self.accelerated(arms)))
        a[:, 2] += gravity
        return position, a

    def inertia_columns(self, pairs: Pairs) -> FloatArray:
        """
        Return I alpha + omega x I omega in each link by components of I, (N, 6, axis, B).

        :param pairs: the rows and columns of the components.
        """
        w, a = (dot(self.links, rate[:, None]) for rate in (self.omega, self.alpha))
        first, second = np.zeros((2, len(w), len(pairs), *w.shape[1:]))
        for k, (x, y) in enumerate(pairs):
            first[:, k, x], second[:, k, x] = a[:, y], w[:, y]
            first[:, k, y], second[:, k, y] = a[:, x], w[:, x]
        return np.asarray(first + cross(w[:, None], second))

    def inertia_moment(self, inertias: FloatArray) -> FloatArray:
        """Return I alpha + omega x I omega, (N, xyz, B), of matrices I (N, 3, 3)."""
        w, a = (dot(self.links, rate[:, None]) for rate in (self.omega, self.alpha))
        return combined(self.links, inertias @ a + cross(w, inertias @ w))


def matrices_of(inertias: FloatArray, pairs: Pairs) -> FloatArray:
    """Return the matrices (N, 3, 3) of inertias (N, 6)."""
    matrices = np.empty((len(inertias), 3, 3))
    for k, (x, y) in enumerate(pairs):
        matrices[:, x, y] = matrices[:, y, x] = inertias[:, k]
    return matrices


def regressor(geometry: Geometry, q: FloatArray, qd: FloatArray, qdd: FloatArray,
              gravity: float = 0.0) -> FloatArray:
    """
    Return d tau / d parameters, (M, N, 10 N), parameters of link 1 first (`PARAMETERS`).

    :param q: (M, N) rad; `qd` in rad/s and `qdd` in rad/s^2.
    :param gravity: downwards along the base's z, m/s^2; 0 for the dynamic torque alone.
    """
    m, n = q.shape
    columns = np.zeros((n, n, 10, m))
    for rows in batches(m):
        motion = LinkMotion.on_axes(geometry.rotations, q[rows], qd[rows], qdd[rows])
        position, a = motion.origins(combined(motion.links[:-1], geometry.origins[1:]), gravity)
        # By mass and first moment; an inertia has no force.
        force = np.concatenate([a[:, None], motion.accelerated(motion.links)], axis=1)
        about = cross(position[:, None], force)
        about[:, 1:] += cross(motion.links, a[:, None])
        inertia, z = motion.inertia_columns(_PAIRS), motion.z
        lever = cross(z, position)
        for j in range(n):
            own = columns[j, j:, :, rows]
            own[:, :4] = dot(z[j], about[j:]) - dot(lever[j], force[j:])
            own[:, 4:] = dot(dot(z[j], motion.links[j:])[:, None], inertia[j:])
    return columns.reshape(n, 10 * n, m).transpose(2, 0, 1)


def inverse_dynamics(geometry: Geometry, q: FloatArray, qd: FloatArray, qdd: FloatArray,
                     parameters: FloatArray, gravity: float = 0.0) -> FloatArray:
    """
    Return the torque (M, N) in N·m of parameters (10 N,): `regressor` times these, but faster.

    The other arguments are those of `regressor`.
    """
    links = parameters.reshape(-1, len(PARAMETERS))
    motion = LinkMotion.on_axes(geometry.rotations, q, qd, qdd)
    position, a = motion.origins(combined(motion.links[:-1], geometry.origins[1:]), gravity)
    moment = combined(motion.links, links[:, 1:4])
    force = links[:, 0, None, None] * a + motion.accelerated(moment)
    about = suffix_sums(cross(moment, a) + motion.inertia_moment(matrices_of(links[:, 4:], _PAIRS))
                        + cross(position, force)) - cross(position, suffix_sums(force))
    return np.asarray(dot(motion.z, about).T)


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the scalar products over the last axis but one, (..., B)."""
    return np.asarray(a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :]
                      + a[..., 2, :] * b[..., 2, :])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products over the last axis but one, (..., xyz, B)."""
    result = np.empty(np.broadcast(a, b).shape)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[..., i, :] * b[..., j, :], a[..., j, :] * b[..., i, :],
                    out=result[..., k, :])
    return result


def outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a b', (N, 3, 3, B), of vectors (N, 3, B)."""
    return np.asarray(a[:, :, None] * b[:, None])


def times(matrices: FloatArray, v: FloatArray) -> FloatArray:
    """Return matrices (..., 3, 3, B) times vectors (..., 3, B)."""
    return np.asarray((matrices * v[..., None, :, :]).sum(axis=-2))


def cross_matrices(v: FloatArray) -> FloatArray:
    """Return the matrices (N, 3, 3, B) of v x for v (N, 3, B)."""
    matrices = np.zeros((len(v), 3, 3, v.shape[-1]))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        matrices[:, j, i], matrices[:, i, j] = v[:, k], -v[:, k]
    return matrices


def next_values(values: FloatArray) -> FloatArray:
    """Return the values of the next joint, 0 for the last."""
    return np.concatenate([values[1:], np.zeros_like(values[:1])])


def prefix_sums(values: FloatArray) -> FloatArray:
    """Return the sums over all joints before each."""
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(values[:-1], axis=0)])


def suffix_sums(values: FloatArray) -> FloatArray:
    """Return the sums over each joint and all beyond it."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def combined(axes: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the sums (K, xyz, B) of the axes (K, A, xyz, B) with weights (K, A) or (K, A, B)."""
    weights = weights[..., None] if weights.ndim == 2 else weights
    return np.asarray(sum(weights[:, k, None] * axes[:, k] for k in range(axes.shape[1])))
