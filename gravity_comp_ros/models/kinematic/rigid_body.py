"""
Rigid-body dynamics of a serial arm, linear in the inertial parameters of its links.

Frames are those of `Geometry`: frame i rotates with link i, its z is the axis of joint i. With
omega, alpha and a the angular velocity, the angular acceleration and the acceleration of the
origin of frame i, in coordinates of frame i, the wrench on the link at that origin is

    force  = m a + (alpha^ + omega^ omega^) (m c)
    moment = I alpha + omega^ I omega + (m c)^ a,

I about the origin (recursive Newton-Euler; B. Siciliano, O. Khatib, Springer Handbook of
Robotics, ch. 3 and 6). The torque of joint j is the z component of the moments of all links from
j outwards, taken at its origin. Gravity is an acceleration of the base; without it the columns
are those of the mass matrix and of the centrifugal and Coriolis torque.

Not every parameter is identifiable, because a link rotates about one axis and carries the next.
Base parameters (M. Gautier, W. Khalil, IEEE Transactions on Robotics and Automation 6, 1990) are
the identifiable ones, with the others grouped into them.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import about_z, ForwardKinematics, skew
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.vectors import combined, cross, dot, suffix_sums
import numpy as np

# Parameters of each link: mass, first moment and inertia about the origin of its frame.
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Ixz', 'Iyy', 'Iyz', 'Izz')
_INERTIAS = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])


def regressor(geometry: Geometry, q: FloatArray, qd: FloatArray, qdd: FloatArray,
              gravity: float = 0.0) -> FloatArray:
    """
    Return d tau / d parameters, (M, N, 10 N), parameters of link 1 first (`PARAMETERS`).

    :param q: (M, N) rad; `qd` in rad/s and `qdd` in rad/s^2.
    :param gravity: downwards along the base's z, m/s^2; 0 for the dynamic torque alone.
    """
    m, n = q.shape
    links = _links(geometry, q, qd, qdd, gravity)
    columns = np.zeros((m, n, 10 * n))
    for i, link in enumerate(links):
        force, moment = link.wrench()
        own = slice(10 * i, 10 * i + 10)
        columns[:, i, own] = moment[:, 2]
        for j in range(i, 0, -1):
            # From the coordinates and origin of frame j to those of frame j - 1.
            force, moment = links[j].before(force, moment, geometry.origins[j])
            columns[:, j - 1, own] = moment[:, 2]
    return columns


def inverse_dynamics(geometry: Geometry, q: FloatArray, qd: FloatArray, qdd: FloatArray,
                     parameters: FloatArray, gravity: float = 0.0) -> FloatArray:
    """
    Return the torque (M, N) in N·m of parameters (10 N,): `regressor` times these, but faster.

    Vectors are in coordinates of the base, so that every recursion over the joints is a sum. The
    other arguments are those of `regressor`.
    """
    links = parameters.reshape(-1, len(PARAMETERS))
    kinematics = ForwardKinematics(geometry.rotations, q)
    axes, z = kinematics.rotated, kinematics.frames[:, 2]
    speeds = z * qd.T[:, None]
    omega = np.cumsum(speeds, axis=0)
    alpha = np.cumsum(z * qdd.T[:, None] + cross(omega - speeds, speeds), axis=0)

    def accelerated(v: FloatArray, k: slice = slice(None)) -> FloatArray:
        """Return the acceleration of vectors v (K, xyz, B) fixed in links k."""
        return cross(alpha[k], v) + cross(omega[k], cross(omega[k], v))

    arms = combined(axes[:-1], geometry.origins[1:])
    position, a = np.zeros_like(z), np.zeros_like(z)
    a[0, 2] = gravity
    position[1:], a[1:] = arms, accelerated(arms, slice(-1))
    position, a = np.cumsum(position, axis=0), np.cumsum(a, axis=0)
    moment = combined(axes, links[:, 1:4])
    force = links[:, 0, None, None] * a + accelerated(moment)
    inertia = links[:, _INERTIAS]                                        # (N, 3, 3)
    momentum, change = (combined(axes, inertia @ dot(axes, rate[:, None]))
                        for rate in (omega, alpha))
    torque = cross(moment, a) + change + cross(omega, momentum) + cross(position, force)
    torque = suffix_sums(torque) - cross(position, suffix_sums(force))
    return np.asarray(dot(z, torque).T)


@dataclass(frozen=True, eq=False)
class _Link:
    """Motion of a link (M, 3) in its own coordinates; `rotation` transforms them to link i-1."""

    rotation: FloatArray
    omega: FloatArray
    alpha: FloatArray
    a: FloatArray

    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """Return force and moment at the origin by parameter, (M, 3, 10) each."""
        m = len(self.omega)
        spin = skew(self.omega)
        force, moment = np.zeros((m, 3, 10)), np.zeros((m, 3, 10))
        force[:, :, 0] = self.a
        force[:, :, 1:4] = skew(self.alpha) + spin @ spin
        moment[:, :, 1:4] = -skew(self.a)
        moment[:, :, 4:] = _times(self.alpha) + spin @ _times(self.omega)
        return force, moment

    def before(self, force: FloatArray, moment: FloatArray,
               origin: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return forces and moments (M, 3, K) in coordinates and at the origin of link i-1."""
        force = self.rotation @ force
        return force, self.rotation @ moment + skew(origin) @ force


def _links(geometry: Geometry, q: FloatArray, qd: FloatArray, qdd: FloatArray,
           gravity: float) -> list[_Link]:
    m, n = q.shape
    omega, alpha = np.zeros((m, 3)), np.zeros((m, 3))
    a = np.broadcast_to(np.array([0.0, 0.0, gravity]), (m, 3))
    links = []
    for i in range(n):
        rotation = geometry.rotations[i] @ about_z(q[:, i])
        back = rotation.transpose(0, 2, 1)
        origin = geometry.origins[i]
        a = a + _cross(alpha, origin) + _cross(omega, _cross(omega, origin))
        a, omega, alpha = ((back @ part[:, :, None])[:, :, 0] for part in (a, omega, alpha))
        joint_rate = np.zeros((m, 3))
        joint_rate[:, 2] = qd[:, i]
        alpha = alpha + _cross(omega, joint_rate)
        alpha[:, 2] += qdd[:, i]
        omega = omega + joint_rate
        links.append(_Link(rotation, omega, alpha, a))
    return links


def _cross(v: FloatArray, w: FloatArray) -> FloatArray:
    """Return v x w of v (M, 3) and w (3,) or (M, 3); `np.cross` takes several times as long."""
    (a, b, c), (x, y, z) = v.T, w.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def _times(v: FloatArray) -> FloatArray:
    """Return L (M, 3, 6) with I v = L (Ixx, Ixy, Ixz, Iyy, Iyz, Izz) for v (M, 3)."""
    result = np.zeros((len(v), 3, 6))
    x, y, z = v.T
    result[:, 0, 0], result[:, 0, 1], result[:, 0, 2] = x, y, z
    result[:, 1, 1], result[:, 1, 3], result[:, 1, 4] = x, y, z
    result[:, 2, 2], result[:, 2, 4], result[:, 2, 5] = x, y, z
    return result
