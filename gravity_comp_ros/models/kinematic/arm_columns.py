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

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.kinematic.chain import Chain, tilt
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.rigid_body import (
    combined, cross, cross_matrices, dot, LinkMotion, matrices_of, next_values, outer, prefix_sums,
    regressor, suffix_sums, times)
import numpy as np

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Share of a column that must lie outside the span of those before it: right angles of descriptions
# are rounded, at worst to 1.57. The parameters of such a column would be unlimited.
_DEPENDENT = 1e-3
_GENERIC_TILT = (0.5, 0.3)  # rad


def motion_columns(motion: ArmMotion) -> FloatArray:
    """Return d torque / d (lengths, inertias), (N, 9N - 3, B)."""
    n, m = len(motion.links), motion.links.shape[-1]
    arms, z, beyond = motion.links[:-1], motion.z, motion.beyond
    accelerated = motion.accelerated(arms)                      # (N - 1, axis, xyz, B)
    # The length of link i moves the bodies beyond it; joint j carries those beyond both.
    moment = (cross(beyond[1:, None], accelerated)
              + cross(arms, motion.moved_beyond[1:, None]))
    carries = np.arange(n)[:, None] <= np.arange(n)
    columns = np.empty((n, 9 * n - 3, m))
    lengths = columns[:, :3 * n - 3].reshape(n, n - 1, 3, m)
    inertias = columns[:, 3 * n - 3:].reshape(n, n, 6, m)
    torque, lever = motion.inertia_columns(_PAIRS), cross(z, beyond)
    for j in range(n):
        lengths[j, j:] = dot(z[j], moment[j:])
        lengths[j, :j] = dot(lever[j], accelerated[:j])
        along = dot(z[j], motion.links[j:])                    # (N - j, axis, B)
        inertias[j, j:] = dot(along[:, None], torque[j:])
    inertias[~carries] = 0.0
    return columns


def motion_torque(motion: ArmMotion, lengths: FloatArray, inertias: FloatArray) -> FloatArray:
    """Return the torque (B, N) in N·m of lengths (N - 1, 3) in m and inertias (N, 6)."""
    moments, before = motion.moments(combined(motion.links[:-1], lengths), inertias)
    lever = cross(motion.z, motion.beyond)
    return np.asarray((dot(motion.z, moments) + dot(lever, before)).T)


def motion_torque_by_tilts(motion: ArmMotion, lengths: FloatArray, inertias: FloatArray,
                           frames: Iterable[int]) -> FloatArray:
    """
    Return the derivative (N, 2N, B) of the torque of motion by the tilts of the axes.

    The torque is `motion_columns` times lengths and inertias; `Chain.moved` defines the tilts.

    A tilt by e of frame k turns all links from k on. As seen from them, the link before k turns by
    -e: its angular velocity changes by -w, w = e x omega, and with c = e x alpha - w x omega the
    acceleration of a vector v of a link i >= k by -(c x v + 2 w x (omega_i x v)). The torques of
    the joints from k on change by that alone, which is linear in c and w. The joints before k
    carry the turned links.

    :param lengths: (N - 1, 3) in m. :param inertias: (N, 6) in kg·m^2, as in `_PAIRS`.
    :param frames: the numbers of the axes that tilt; the columns of the others are 0.
    """
    n, z, beyond = len(motion.links), motion.z, motion.beyond
    arms = np.concatenate([combined(motion.links[:-1], lengths), np.zeros((1, *z.shape[1:]))])
    moments, before = motion.moments(arms[:-1], inertias)
    velocities = cross(motion.omega, arms)
    position, velocity = (prefix_sums(each) for each in (arms, velocities))
    moving = suffix_sums(cross(motion.omega, beyond - next_values(beyond)))
    by_c, by_w = _turned_moments(motion, inertias, arms, velocities, moving)
    lever = cross(z, beyond)
    own_c, own_w = times(by_c, z), times(by_w, z)
    columns = np.zeros((n, n, 2, z.shape[-1]))
    result = columns.transpose(1, 2, 0, 3)     # frame, axis, joint
    for k in set(frames) - {0}:                # the base does not move
        e, omega, alpha = motion.frames[k, :2], motion.omega[k - 1], motion.alpha[k - 1]
        w = cross(e, omega)
        c = cross(e, alpha) - cross(w, omega)
        within, carriers = slice(k, None), slice(None, k)
        from_k = lever[within]
        result[k, :, within] = -(
            dot(c[:, None], own_c[within] + cross(position[within] - position[k], from_k))
            + dot(w[:, None], own_w[within]
                  + 2.0 * cross(velocity[within] - velocity[k], from_k))
            + dot(e[:, None], cross(before[k], from_k)))
        moment = (cross(e, moments[k]) + cross(cross(e, beyond[k]), before[k])
                  - times(by_c[k], c) - times(by_w[k].swapaxes(0, 1), w))
        force = (cross(e, motion.moved_beyond[k]) - cross(c, beyond[k])
                 - 2.0 * cross(w, moving[k]))
        arm = cross(z[carriers], position[k] - position[carriers])
        result[k, :, carriers] = (dot(z[carriers], moment[:, None])
                                  + dot(arm, force[:, None]))
    return columns.reshape(n, 2 * n, -1)


def _turned_moments(motion: ArmMotion, inertias: FloatArray, arms: FloatArray,
                    velocities: FloatArray, moving: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return X_j and Y_j, (N, 3, 3, B): the moment about joint j is X_j c + Y_j' w less.

    X_j is the inertia of the links from j on.
    """
    axes, matrices = motion.links, matrices_of(inertias, _PAIRS)
    turned = (matrices @ axes.reshape(len(axes), 3, -1)).reshape(axes.shape)
    inertia = np.asarray(sum(axes[:, k, :, None] * turned[:, k, None] for k in range(3)))
    beyond, moved = next_values(motion.beyond), next_values(moving)
    one = np.eye(3)[:, :, None]
    spin = motion.omega[:, None]
    by_c = (inertia + 2.0 * one * dot(arms, beyond)[:, None, None]
            - outer(beyond, arms) - outer(arms, beyond))
    # omega x I and I x omega, column by column of the symmetric I.
    crossed = cross(spin, inertia).swapaxes(1, 2)
    by_w = (crossed + crossed.swapaxes(1, 2) + cross_matrices(times(inertia, motion.omega))
            + 2.0 * (one * (dot(velocities, beyond) + dot(moved, arms))[:, None, None]
                     - outer(beyond, velocities) - outer(arms, moved)))
    return suffix_sums(by_c), suffix_sums(by_w)


@dataclass(frozen=True, eq=False)
class ArmMotion(LinkMotion):
    """
    The moving links of a chain.

    `beyond` and `moved_beyond` (N, xyz, B) are sums over a link and all beyond it: of the first
    moments over g, and of their accelerations.
    """

    beyond: FloatArray
    moved_beyond: FloatArray

    @classmethod
    def of(cls, chain: Chain, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> ArmMotion:
        links = cls.on_axes(chain.axes, q, qd, qdd)
        moments = combined(links.links[:, :2], chain.moments / STANDARD_GRAVITY)
        return cls(**vars(links), beyond=suffix_sums(moments),
                   moved_beyond=suffix_sums(links.accelerated(moments)))

    def moments(self, arms: FloatArray, inertias: FloatArray) -> tuple[FloatArray, FloatArray]:
        """
        Return moments and accelerations of joint j, (N, xyz, B).

        The moments are those of the links from j on. The accelerations are those of the origin of
        j: the links before j act by them on the bodies beyond.

        :param arms: the lengths in the base, (N - 1, xyz, B).
        """
        accelerated = self.accelerated(arms)
        own = self.inertia_moment(matrices_of(inertias, _PAIRS))
        own[:-1] += cross(self.beyond[1:], accelerated) + cross(arms, self.moved_beyond[1:])
        before = np.zeros_like(own)
        np.cumsum(accelerated, axis=0, out=before[1:])
        return suffix_sums(own), before


@dataclass(frozen=True, eq=False)
class Basis:
    """
    Base parameters of a geometry: `kept` (K,) among the 10 N parameters of the links.

    `grouped` (K, 10 N) are the base parameters of a unit of each parameter, and `dynamic`
    (B, N, 10 N) the columns of its torque of motion at random states with rates of 1.
    """

    kept: IntArray
    grouped: FloatArray
    dynamic: FloatArray


@lru_cache(maxsize=16)
def basis_of(geometry: Geometry) -> Basis:
    """Return the base parameters, the first moments and masses of the last links first."""
    n = geometry.n_joints
    # On a tilted base, so that the set is the same for every mounting and every zero angle.
    rotations = geometry.rotations.copy()
    rotations[0] = tilt(np.array([_GENERIC_TILT]))[0] @ rotations[0]
    geometry = replace(geometry, rotations=rotations)
    q = random_poses(n)
    qd, qdd = np.random.default_rng(1).normal(size=(2, *q.shape))
    each = regressor(geometry, q, qd, qdd, STANDARD_GRAVITY)
    columns = each.reshape(-1, 10 * n)
    kept = list(geometry.base) or _independent(columns, n)
    still = regressor(geometry, q, 0.0 * q, 0.0 * q, STANDARD_GRAVITY)
    grouped = np.linalg.lstsq(columns[:, kept], columns, rcond=None)[0]
    return Basis(np.array(kept, dtype=np.int64), np.asarray(grouped), each - still)


def _independent(columns: FloatArray, n: int) -> list[int]:
    """Return the numbers of independent columns (R, 10 N), which span all of them."""
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
    return kept


def described_columns(geometry: Geometry, q: FloatArray, qd: FloatArray,
                      qdd: FloatArray) -> FloatArray:
    """Return d torque / d base parameters (B, N, K), gravity included."""
    return regressor(geometry, q, qd, qdd, STANDARD_GRAVITY)[:, :, kept_parameters(geometry)]


def kept_parameters(geometry: Geometry) -> IntArray:
    """Return the numbers (K,) of the base parameters."""
    return np.array(geometry.base) if geometry.base else basis_of(geometry).kept
