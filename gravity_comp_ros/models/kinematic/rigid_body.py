"""
The torque of a serial arm of rigid bodies, linear in the inertial parameters of its links.

Frames are those of `Geometry`: frame i turns with link i, its z is the axis of joint i. With
omega, alpha and a the angular velocity, the angular acceleration and the acceleration of the
origin of frame i, in coordinates of frame i, the link needs at that origin

    force  = m a + (alpha^ + omega^ omega^) (m c)
    moment = I alpha + omega^ I omega + (m c)^ a,

I about the origin (recursive Newton-Euler; B. Siciliano, O. Khatib, Springer Handbook of
Robotics, ch. 3 and 6). The torque of joint j is the z component of the moments of all links from
j outwards, taken at its origin. Gravity is an acceleration of the base; without it the columns
are those of the mass matrix and of the centrifugal and Coriolis torque alone.

Not every parameter can be seen: a link turns about one axis and carries the next. Base parameters
(M. Gautier, W. Khalil, IEEE Transactions on Robotics and Automation 6, 1990) are those that
can, with the others grouped into them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

# Of each link: mass, first moment and inertia about the origin of its frame.
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Ixz', 'Iyy', 'Iyz', 'Izz')
# The number of the first inertia.
_INERTIAS = 4
# The order in which parameters are taken as base parameters: those about the axis first, then
# first moments; the others are grouped into them.
_ORDER = (9, 4, 5, 6, 8, 1, 2, 7, 3, 0)
# Of a column in the span of others less than this share is left.
_DEPENDENT = 1e-7


def regressor(geometry: Geometry, q: FloatArray, qd: FloatArray, qdd: FloatArray,
              gravity: float = 0.0) -> FloatArray:
    """
    Return d tau / d parameters, (M, N, 10 N), parameters of link 1 first (`PARAMETERS`).

    :param q: (M, N) rad; `qd` in rad/s and `qdd` in rad/s^2 alike.
    :param gravity: of the base's frame, downwards, m/s^2; 0 leaves the torque of motion alone.
    """
    m, n = q.shape
    links = _links(geometry, q, qd, qdd, gravity)
    found = np.zeros((m, n, 10 * n))
    for i, link in enumerate(links):
        force, moment = link.wrench()
        here = slice(10 * i, 10 * i + 10)
        found[:, i, here] = moment[:, 2]
        for j in range(i, 0, -1):
            # From the coordinates and origin of frame j to those of frame j - 1.
            force = links[j].rotation @ force
            moment = links[j].rotation @ moment + _cross(geometry.origins[j]) @ force
            found[:, j - 1, here] = moment[:, 2]
    return found


@dataclass(frozen=True, eq=False)
class _Link:
    """Motion of a link (M, 3) in its own coordinates, and their rotation into the one before."""

    rotation: FloatArray
    omega: FloatArray
    alpha: FloatArray
    a: FloatArray

    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """Return force and moment at the origin by parameter, (M, 3, 10) each."""
        m = len(self.omega)
        spin = _cross(self.omega)
        force, moment = np.zeros((m, 3, 10)), np.zeros((m, 3, 10))
        force[:, :, 0] = self.a
        force[:, :, 1:4] = _cross(self.alpha) + spin @ spin
        moment[:, :, 1:4] = -_cross(self.a)
        moment[:, :, 4:] = _times(self.alpha) + spin @ _times(self.omega)
        return force, moment


def _links(geometry: Geometry, q: FloatArray, qd: FloatArray, qdd: FloatArray,
           gravity: float) -> list[_Link]:
    m, n = q.shape
    omega, alpha = np.zeros((m, 3)), np.zeros((m, 3))
    a = np.broadcast_to(np.array([0.0, 0.0, gravity]), (m, 3))
    found = []
    for i in range(n):
        rotation = geometry.rotations[i] @ _about_z(q[:, i])
        back = rotation.transpose(0, 2, 1)
        origin = geometry.origins[i]
        a = a + np.cross(alpha, origin) + np.cross(omega, np.cross(omega, origin))
        a, omega, alpha = ((back @ part[:, :, None])[:, :, 0] for part in (a, omega, alpha))
        turn = np.zeros((m, 3))
        turn[:, 2] = qd[:, i]
        alpha = alpha + np.cross(omega, turn)
        alpha[:, 2] += qdd[:, i]
        omega = omega + turn
        found.append(_Link(rotation, omega, alpha, a))
    return found


def _about_z(angle: FloatArray) -> FloatArray:
    found = np.zeros((len(angle), 3, 3))
    found[:, 0, 0] = found[:, 1, 1] = np.cos(angle)
    found[:, 1, 0] = np.sin(angle)
    found[:, 0, 1] = -found[:, 1, 0]
    found[:, 2, 2] = 1.0
    return found


def _cross(v: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of v x for v (..., 3)."""
    v = np.asarray(v)
    found = np.zeros((*v.shape[:-1], 3, 3))
    found[..., 0, 1], found[..., 0, 2], found[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return found - np.swapaxes(found, -1, -2)


def _times(v: FloatArray) -> FloatArray:
    """Return L (M, 3, 6) with I v = L (Ixx, Ixy, Ixz, Iyy, Iyz, Izz) for v (M, 3)."""
    found = np.zeros((len(v), 3, 6))
    x, y, z = v.T
    found[:, 0, 0], found[:, 0, 1], found[:, 0, 2] = x, y, z
    found[:, 1, 1], found[:, 1, 3], found[:, 1, 4] = x, y, z
    found[:, 2, 2], found[:, 2, 4], found[:, 2, 5] = x, y, z
    return found


@lru_cache(maxsize=8)
def identifiable(geometry: Geometry) -> tuple[IntArray, IntArray]:
    """
    Return what motion shows beside first moments and masses: inertias, and rotors of joints.

    Inertias (K,) are parameter numbers of the moments and products of inertia among the base
    parameters; rotors (R,) are joint numbers. They are found on motion drawn at random: a column
    counts if it lies outside the span of those before it.
    """
    n = geometry.n_joints
    rng = np.random.default_rng(0)
    q, qd, qdd = (rng.uniform(-np.pi, np.pi, (8 * n + 8, n)) for _ in range(3))
    columns = np.concatenate([regressor(geometry, q, qd, qdd),
                              qdd[:, :, None] * np.eye(n)], axis=2).reshape(-1, 11 * n)
    size = np.linalg.norm(columns, axis=0)
    order = [10 * link + kind for kind in _ORDER for link in range(n)]
    kept: list[int] = []
    basis = np.zeros((len(columns), 0))
    for number in (*order, *range(10 * n, 11 * n)):
        left = columns[:, number] - basis @ (basis.T @ columns[:, number])
        left -= basis @ (basis.T @ left)
        length = float(np.linalg.norm(left))
        if length > _DEPENDENT * max(float(size[number]), 1e-12):
            kept.append(number)
            basis = np.column_stack([basis, left / length])
    inertias = sorted(k for k in kept if k < 10 * n and k % 10 >= _INERTIAS)
    rotors = [k - 10 * n for k in kept if k >= 10 * n]
    return np.array(inertias, dtype=np.int64), np.array(rotors, dtype=np.int64)
