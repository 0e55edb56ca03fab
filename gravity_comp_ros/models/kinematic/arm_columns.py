"""
Columns of the torque of motion: on the axes of a chain, and on those of a robot description.

Of a chain: let p_i be the origin of frame i + 1 in link i, and I_i the inertia of link i about the
origin of its frame, with the masses beyond it concentrated at the end of the link. With
b_i = R_i h_i / g, in the base frame, the kinetic energy is (J. Wittenburg, Dynamics of Systems of
Rigid Bodies, 1977: augmented bodies)

    T = sum_{i < k} d(R_i p_i)/dt . d b_k/dt + 1/2 sum_i w_i . R_i I_i R_i' w_i,

so that the torque of motion is linear in p_i and I_i for given axes and moments.

Of a description: the torque is linear in the inertial parameters of the links (`rigid_body`). The
base parameters are a maximal set of linearly independent columns (M. Gautier, W. Khalil, IEEE
Transactions on Robotics and Automation 6, 1990).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics, skew, tilt
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.rigid_body import regressor
import numpy as np

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Share of a column that must lie outside the span of those before it.
_DEPENDENT = 1e-7
_POSES = 60
_GENERIC_TILT = (0.5, 0.3)  # rad


def motion_columns(chain: Chain, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Return d torque / d (lengths, inertias), (B, N, 9N - 3)."""
    n, m = chain.n_joints, len(q)
    kinematics = ForwardKinematics(chain.axes, q)
    z = kinematics.frames[:, 2].transpose(0, 2, 1)              # (N, B, 3)
    links = kinematics.rotated.transpose(0, 3, 2, 1)            # (N, B, xyz, axis)
    spin, turn = _rates(z, qd, qdd)
    # Acceleration of a vector fixed in link i is turn[i] times that vector.
    moments = np.einsum('nbxa,na->nbx', links[:, :, :, :2], chain.moments) / STANDARD_GRAVITY
    moved = np.einsum('nbxy,nby->nbx', turn, moments)
    beyond, moved_beyond = _suffix_sums(moments), _suffix_sums(moved)
    columns = np.zeros((m, n, 9 * n - 3))
    for i in range(n - 1):
        arms = links[i].transpose(0, 2, 1)                      # (B, axis, xyz)
        accelerated = np.einsum('bxy,bay->bax', turn[i], arms)
        here = slice(3 * i, 3 * i + 3)
        moment = _cross(beyond[i + 1][:, None], accelerated)
        moment += _cross(arms, moved_beyond[i + 1][:, None])
        columns[:, :i + 1, here] = np.einsum('jbx,bax->bja', z[:i + 1], moment)
        for j in range(i + 1, n):
            columns[:, j, here] = np.einsum(
                'bx,bax->ba', z[j], _cross(beyond[j][:, None], accelerated))
    for i in range(n):
        at = 3 * (n - 1) + 6 * i
        torque = _inertia_columns(links[i], spin[i], turn[i])   # (B, 6, xyz)
        columns[:, :i + 1, at:at + 6] = np.einsum('jbx,bkx->bjk', z[:i + 1], torque)
    return columns


def motion_torque(chain: Chain, lengths: FloatArray, inertias: FloatArray, q: FloatArray,
                  qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """
    Return the torque of motion (B, N) in N·m: `motion_columns` times lengths and inertias.

    :param lengths: (N - 1, 3) in m. :param inertias: (N, 6) in kg·m^2, as in `_PAIRS`.
    """
    n = chain.n_joints
    kinematics = ForwardKinematics(chain.axes, q)
    z = kinematics.frames[:, 2].transpose(0, 2, 1)
    links = kinematics.rotated.transpose(0, 3, 2, 1)
    spin, turn = _rates(z, qd, qdd)
    moments = np.einsum('nbxa,na->nbx', links[:, :, :, :2], chain.moments) / STANDARD_GRAVITY
    beyond = _suffix_sums(moments)
    moved_beyond = _suffix_sums(np.einsum('nbxy,nby->nbx', turn, moments))
    arms = np.einsum('nbxa,na->nbx', links[:n - 1], lengths)
    accelerated = np.einsum('nbxy,nby->nbx', turn[:n - 1], arms)
    # Moment about joint j: of link i itself for j <= i, of those beyond max(i, j - 1) for all i.
    own = np.cross(beyond[1:], accelerated) + np.cross(arms, moved_beyond[1:])
    own += np.stack([_inertia_moment(links[i], spin[i], turn[i], inertias[i])
                     for i in range(n - 1)]) if n > 1 else 0.0
    last = _inertia_moment(links[-1], spin[-1], turn[-1], inertias[-1])
    outward = _suffix_sums(np.concatenate([own, last[None]]))
    inward = np.cumsum(np.concatenate([0.0 * accelerated[:1], accelerated]), axis=0) if n > 1 \
        else np.zeros_like(beyond)
    return np.asarray(np.einsum('nbx,nbx->bn', z, outward + np.cross(beyond, inward)))


def _inertia_moment(link: FloatArray, omega: FloatArray, turn: FloatArray,
                    inertia: FloatArray) -> FloatArray:
    """Return I alpha + omega x I omega in the base, (B, 3)."""
    matrix = np.empty((3, 3))
    for (x, y), value in zip(_PAIRS, inertia):
        matrix[x, y] = matrix[y, x] = value
    w = np.einsum('bxa,bx->ba', link, omega)
    a = np.einsum('bxa,bx->ba', link, _alpha(turn))
    return np.einsum('bxa,ba->bx', link, a @ matrix + np.cross(w, w @ matrix))


def _alpha(turn: FloatArray) -> FloatArray:
    """Return the angular acceleration (B, 3) in turn = [alpha]x + [omega]x^2."""
    skewed = 0.5 * (turn - turn.transpose(0, 2, 1))  # [omega]x^2 is symmetric
    return np.stack([skewed[:, 2, 1], skewed[:, 0, 2], skewed[:, 1, 0]], axis=1)


def _rates(z: FloatArray, qd: FloatArray, qdd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return each link's angular velocity (N, B, 3), and [alpha]x + [omega]x^2 (N, B, 3, 3)."""
    n, m = len(z), len(qd)
    omega, alpha = np.zeros((m, 3)), np.zeros((m, 3))
    spin, turn = np.empty((n, m, 3)), np.empty((n, m, 3, 3))
    for i in range(n):
        alpha = (alpha + z[i] * qdd[:, [i]]
                 + _cross(omega, z[i]) * qd[:, [i]])
        omega = omega + z[i] * qd[:, [i]]
        cross = skew(omega)
        spin[i], turn[i] = omega, skew(alpha) + cross @ cross
    return spin, turn


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product over the last axis; `np.cross` takes three times as long."""
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[..., i] * b[..., j], a[..., j] * b[..., i], out=result[..., k])
    return result


def _suffix_sums(values: FloatArray) -> FloatArray:
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def _inertia_columns(link: FloatArray, omega: FloatArray, turn: FloatArray) -> FloatArray:
    """Return I alpha + omega x I omega in the base (B, 6, 3) for each component of I."""
    # In coordinates of the link.
    w = np.einsum('bxa,bx->ba', link, omega)
    a = np.einsum('bxa,bx->ba', link, _alpha(turn))
    first, second = np.zeros((2, len(w), 6, 3))
    for k, (x, y) in enumerate(_PAIRS):
        first[:, k, x], second[:, k, x] = a[:, y], w[:, y]
        first[:, k, y], second[:, k, y] = a[:, x], w[:, x]
    return np.einsum('bxa,bka->bkx', link, first + _cross(w[:, None], second))


@dataclass(frozen=True, eq=False)
class Basis:
    """
    Base parameters of a geometry: `kept` (K,) among the 10 N parameters of the links.

    `size` (K,) is the RMS of each column at random states with rates of 1, `is_static` (K,)
    whether it acts at rest.
    """

    kept: IntArray
    size: FloatArray
    is_static: BoolArray


@lru_cache(maxsize=16)
def basis_of(geometry: Geometry) -> Basis:
    """Return the base parameters, the first moments and masses of the last links first."""
    n = geometry.n_joints
    # On a tilted base, so that the set is the same for every mounting and every zero angle.
    rotations = geometry.rotations.copy()
    rotations[0] = tilt(np.array([_GENERIC_TILT]))[0] @ rotations[0]
    geometry = replace(geometry, rotations=rotations)
    rng = np.random.default_rng(0)
    q, qd, qdd = (rng.uniform(-np.pi, np.pi, (_POSES, n)), rng.normal(size=(_POSES, n)),
                  rng.normal(size=(_POSES, n)))
    columns = regressor(geometry, q, qd, qdd, STANDARD_GRAVITY).reshape(-1, 10 * n)
    order = [10 * link + kind for kinds in (range(4), range(4, 10))
             for link in reversed(range(n)) for kind in kinds]
    kept, basis = [], np.zeros((len(columns), 0))
    for number in order:
        outside = columns[:, number] - basis @ (basis.T @ columns[:, number])
        outside -= basis @ (basis.T @ outside)  # again, against rounding
        length = float(np.linalg.norm(outside))
        if length > _DEPENDENT * max(float(np.linalg.norm(columns[:, number])), 1e-9):
            kept.append(number)
            basis = np.column_stack([basis, outside / length])
    still = regressor(geometry, q, 0.0 * q, 0.0 * q, STANDARD_GRAVITY)[:, :, kept]
    size = np.sqrt((columns[:, kept] ** 2).mean(axis=0))
    static = (still ** 2).mean(axis=(0, 1)) > 1e-12
    return Basis(np.array(kept, dtype=np.int64), size, static)


def described_columns(geometry: Geometry, q: FloatArray, qd: FloatArray,
                      qdd: FloatArray) -> FloatArray:
    """Return d torque / d base parameters (B, N, K), gravity included."""
    return regressor(geometry, q, qd, qdd, STANDARD_GRAVITY)[:, :, kept_parameters(geometry)]


def kept_parameters(geometry: Geometry) -> IntArray:
    """Return the numbers (K,) of the base parameters; small changes of angles keep them."""
    return basis_of(geometry).kept
