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
    links, z, spin, acceleration, turn, beyond, moved_beyond = _motion(chain, q, qd, qdd)
    arms = links[:-1].swapaxes(2, 3)                            # (N - 1, B, axis, xyz)
    accelerated = np.einsum('nbxy,nbay->nbax', turn[:-1], arms)
    # The length of link i moves the bodies beyond it; joint j carries those beyond both.
    moment = (_cross(beyond[1:, :, None], accelerated)
              + _cross(arms, moved_beyond[1:, :, None]))
    carries = np.arange(n)[:, None] <= np.arange(n)
    lengths = np.where(carries[:, :-1, None], np.einsum('jbx,nbax->bjna', z, moment),
                       np.einsum('jbx,nbax->bjna', _cross(z, beyond), accelerated))
    torque = _inertia_columns(links, spin, acceleration)        # (N, B, 6, xyz)
    inertias = carries[:, :, None] * np.einsum('jbx,nbkx->bjnk', z, torque)
    return np.concatenate([lengths.reshape(m, n, -1), inertias.reshape(m, n, -1)], axis=2)


def motion_torque(chain: Chain, lengths: FloatArray, inertias: FloatArray, q: FloatArray,
                  qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """
    Return the torque of motion (B, N) in N·m: `motion_columns` times lengths and inertias.

    :param lengths: (N - 1, 3) in m. :param inertias: (N, 6) in kg·m^2, as in `_PAIRS`.
    """
    links, z, spin, acceleration, turn, beyond, moved_beyond = _motion(chain, q, qd, qdd)
    arms = np.einsum('nbxa,na->nbx', links[:-1], lengths)
    accelerated = np.einsum('nbxy,nby->nbx', turn[:-1], arms)
    # Moment about joint j: of each link for j <= i, of the lengths before j on the bodies beyond.
    own = _inertia_moment(links, spin, acceleration, inertias)
    own[:-1] += _cross(beyond[1:], accelerated) + _cross(arms, moved_beyond[1:])
    before = np.zeros_like(beyond)
    np.cumsum(accelerated, axis=0, out=before[1:])
    return np.asarray(np.einsum('nbx,nbx->bn', z, _suffix_sums(own) + _cross(beyond, before)))


def _motion(chain: Chain, q: FloatArray, qd: FloatArray, qdd: FloatArray
            ) -> tuple[FloatArray, ...]:
    """
    Return links (N, B, xyz, axis), axes z (N, B, 3), `_rates`, and sums over the links beyond.

    The sums (N, B, 3) are those of the first moments over g, and of their accelerations: that of a
    vector fixed in link i is turn[i] times the vector.
    """
    kinematics = ForwardKinematics(chain.axes, q)
    z = kinematics.frames[:, 2].transpose(0, 2, 1)
    links = kinematics.rotated.transpose(0, 3, 2, 1)
    spin, acceleration, turn = _rates(z, qd, qdd)
    moments = np.einsum('nbxa,na->nbx', links[:, :, :, :2], chain.moments) / STANDARD_GRAVITY
    accelerated = np.einsum('nbxy,nby->nbx', turn, moments)
    return (links, z, spin, acceleration, turn, _suffix_sums(moments),
            _suffix_sums(accelerated))


def _inertia_moment(links: FloatArray, omega: FloatArray, alpha: FloatArray,
                    inertias: FloatArray) -> FloatArray:
    """Return I alpha + omega x I omega in the base, (N, B, 3)."""
    matrices = np.empty((len(inertias), 3, 3))
    for k, (x, y) in enumerate(_PAIRS):
        matrices[:, x, y] = matrices[:, y, x] = inertias[:, k]
    w = np.einsum('nbxa,nbx->nba', links, omega)
    a = np.einsum('nbxa,nbx->nba', links, alpha)
    return np.einsum('nbxa,nba->nbx', links, a @ matrices + _cross(w, w @ matrices))


def _rates(z: FloatArray, qd: FloatArray, qdd: FloatArray
           ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return each link's angular velocity and acceleration (N, B, 3), and the matrix of both.

    The matrix is [alpha]x + [omega]x^2, (N, B, 3, 3).
    """
    speeds = z * qd.T[:, :, None]
    omega = np.cumsum(speeds, axis=0)
    alpha = np.cumsum(z * qdd.T[:, :, None] + _cross(omega - speeds, speeds), axis=0)
    turn = skew(omega)
    return omega, alpha, skew(alpha) + turn @ turn


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product over the last axis; `np.cross` takes three times as long."""
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[..., i] * b[..., j], a[..., j] * b[..., i], out=result[..., k])
    return result


def _suffix_sums(values: FloatArray) -> FloatArray:
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def _inertia_columns(links: FloatArray, omega: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return I alpha + omega x I omega in the base (N, B, 6, 3) for each component of I."""
    # In coordinates of the links.
    w = np.einsum('nbxa,nbx->nba', links, omega)
    a = np.einsum('nbxa,nbx->nba', links, alpha)
    first, second = np.zeros((2, *w.shape[:2], 6, 3))
    for k, (x, y) in enumerate(_PAIRS):
        first[..., k, x], second[..., k, x] = a[..., y], w[..., y]
        first[..., k, y], second[..., k, y] = a[..., x], w[..., x]
    return np.einsum('nbxa,nbka->nbkx', links, first + _cross(w[..., None, :], second))


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
