"""
The chain: gravity of a serial arm in terms of axis directions and first moments.

The potential energy of an arm of revolute joints is

    U = sum_i w_i . h_i,    w_i = Rz(q_i).T A_i.T w_{i-1},    w_0 = (0, 0, 1),

where w_i is the vertical in the frame of link i, A_i the fixed rotation from frame i (before joint
i rotates) to the frame of link i-1, and h_i the first moment about axis i of link i and all links
beyond it, times g, in N·m. Gravity is the gradient of U (Yu 2022, Eq. 2); lengths and masses
enter only through h_i.

Quantities without effect on the torques are fixed: the rotation of link frame i about its own
axis (A_i has two free angles, not three), moments along an axis (they act as moments of link i-1
and are included there, so h_i has two components), the rotation of the base about the vertical,
and the common sign of the vertical and all moments. 4N parameters replace the 3^N weights of the
dictionary.

The energy is a sum over the dictionary (Yu 2022, Property 1). A step changes A_i to
A_i exp([d_x, d_y, 0]): it remains a rotation and no angle is singular, parallel axes included.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.poses import batches
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np

# Weights of an expansion below this share of the largest are dropped: axes are estimated to
# 1e-5 rad at best.
_NEGLIGIBLE = 1e-7


@dataclass(frozen=True, eq=False)
class Chain:
    """
    The gravity of a serial arm: `axes` A_i (N, 3, 3), `moments` h_i (N, 2) in N·m.

    :raises DataError: if shapes disagree, a number is not finite, or A_i is no rotation.
    """

    axes: FloatArray
    moments: FloatArray

    def __post_init__(self) -> None:
        axes = np.asarray(self.axes, dtype=np.float64)
        moments = np.asarray(self.moments, dtype=np.float64)
        n = len(axes)
        if axes.shape != (n, 3, 3) or moments.shape != (n, 2) or not n:
            raise DataError(f'chain: axes {axes.shape} with moments {moments.shape}')
        if not (np.isfinite(axes).all() and np.isfinite(moments).all()):
            raise DataError('chain: a number is not finite')
        if not are_rotations(axes):
            raise DataError('chain: an axis is not given by a rotation')
        object.__setattr__(self, 'axes', axes)
        object.__setattr__(self, 'moments', moments)

    @property
    def n_joints(self) -> int:
        return len(self.axes)

    def torque(self, q: FloatArray) -> FloatArray:
        """Return the gravity torque (M, N) in N·m at poses q (M, N) in rad."""
        q = np.asarray(q, dtype=np.float64)
        parts = [ForwardKinematics(self.axes, q[rows]).torque(self.moments)
                 for rows in batches(len(q))]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def gradient(self, q: FloatArray) -> FloatArray:
        """Return d tau_n / d q_j (M, N, N) in N·m/rad at poses q (M, N) in rad."""
        parts = [ForwardKinematics(self.axes, q[rows]).gradient(self.moments)
                 for rows in batches(len(q))]
        return np.concatenate(parts, axis=2).transpose(2, 0, 1)

    def moved(self, step: FloatArray) -> Chain:
        """Return the chain after a step (4N,): axes d (N, 2) in rad, then moments (N, 2)."""
        tilts, change = step.reshape(2, self.n_joints, 2)
        return Chain(self.axes @ tilt(tilts), self.moments + change)

    def with_first_reversed(self) -> Chain:
        """
        Return the chain with the first joint turning in the opposite direction.

        If its axis is vertical, the gravity torque is the same.
        """
        axes, moments, half_turn = self.axes.copy(), self.moments.copy(), np.diag([1., -1., -1.])
        axes[0] = axes[0] @ half_turn
        axes[1:2] = half_turn @ axes[1:2]
        moments[0, 1] *= -1.0
        return Chain(axes, moments)

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return d tau / d step (`moved`), shape (4N, N, M)."""
        kinematics = ForwardKinematics(self.axes, np.asarray(q, dtype=np.float64))
        return np.concatenate([kinematics.axis_columns(self.moments),
                               kinematics.moment_columns()])


class ForwardKinematics:
    """
    Every joint's frame in the base, at M poses.

    `frames` (N, 3, 3, M) are the axes x, y and z of frame i before the rotation of joint i,
    `rotated` the same after it; z is the joint's axis. With S_n = sum_{i >= n} (moments of link i
    in the base) the torque is tau_n = e_z . (z_n x S_n).

    :param sin_cos: the sines and cosines (N, M) of q, if already computed.
    :param base_tilts: rotation vectors (M, 2) in rad of a moving base about two horizontal axes;
        None for a base at rest.
    """

    def __init__(self, axes: FloatArray, q: FloatArray,
                 sin_cos: tuple[FloatArray, FloatArray] | None = None,
                 base_tilts: FloatArray | None = None) -> None:
        n, m = len(axes), q.shape[0]
        sin, cos = (np.sin(q.T), np.cos(q.T)) if sin_cos is None else sin_cos
        self.frames, self.rotated = np.empty((n, 3, 3, m)), np.empty((n, 3, 3, m))
        scratch = np.empty((3, m))
        for i in range(n):
            frame, rotated = self.frames[i], self.rotated[i]
            if i:
                np.matmul(axes[i].T, self.rotated[i - 1].reshape(3, 3 * m),
                          out=frame.reshape(3, 3 * m))
            elif base_tilts is None:
                frame[:] = axes[0].T[:, :, None]
            else:
                frame[:] = (tilt(base_tilts) @ axes[0]).transpose(2, 1, 0)
            np.multiply(cos[i], frame[:2], out=rotated[:2])
            rotated[0] += np.multiply(sin[i], frame[1], out=scratch)
            rotated[1] -= np.multiply(sin[i], frame[0], out=scratch)
            rotated[2] = frame[2]

    def torque(self, moments: FloatArray) -> FloatArray:
        """Return the torque (M, N) of moments (N, 2) on these axes."""
        carried, z = self._carried(moments), self.frames[:, 2]
        return np.asarray((z[:, 0] * carried[:, 1] - z[:, 1] * carried[:, 0]).T)

    def gradient(self, moments: FloatArray) -> FloatArray:
        """
        Return d tau_n / d q_j (N, N, M), symmetric, of moments (N, 2).

        If joint j turns, all that joint n >= j carries rotates about z_j:
        (e_z x z_j) . (z_n x S_n).
        """
        n, _, _, m = self.frames.shape
        z, s = self.frames[:, 2], self._carried(moments)
        lever_x = z[:, 1] * s[:, 2] - z[:, 2] * s[:, 1]
        lever_y = z[:, 2] * s[:, 0] - z[:, 0] * s[:, 2]
        result = np.empty((n, n, m))
        for j in range(n):
            result[j:, j] = z[j, 0] * lever_y[j:] - z[j, 1] * lever_x[j:]
            result[j, j:] = result[j:, j]
        return result

    def moment_columns(self, along: int = 2) -> FloatArray:
        """
        Return d tau / d h, shape (2N, N, M): e_z . (z_n x a) for each moment's axis a.

        :param along: the base axis of the vertical; 2 (z) for gravity.
        """
        n, _, _, m = self.frames.shape
        i, j = (along + 1) % 3, (along + 2) % 3
        z, a = self.frames[:, 2], self.rotated
        columns = np.zeros((n, 2, n, m))
        for k in range(n):
            # Link k rotates about its own joint and those before it.
            part = columns[k, :, :k + 1]
            np.multiply(z[:k + 1, i], a[k, :2, None, j], out=part)
            part -= z[:k + 1, j] * a[k, :2, None, i]
        return columns.reshape(2 * n, n, m)

    def axis_columns(self, moments: FloatArray) -> FloatArray:
        """
        Return d tau / d d, shape (2N, N, M), for rotations of A_j about its own x or y axis e.

        Joint j and all links beyond it rotate about e. So for n >= j the vertical rotates in the
        opposite direction, tau_n' = (e_z x e) . (z_n x S_n), and for n < j only the moments beyond
        j rotate, tau_n' = e_z . (z_n x (e x S_j)).
        """
        n, _, _, m = self.frames.shape
        z, s = self.frames[:, 2], self._carried(moments)
        lever_x = z[:, 1] * s[:, 2] - z[:, 2] * s[:, 1]
        lever_y = z[:, 2] * s[:, 0] - z[:, 0] * s[:, 2]
        columns = np.empty((n, 2, n, m))
        for j in range(n):
            e = self.frames[j, :2]
            beyond, before = columns[j, :, j:], columns[j, :, :j]
            np.multiply(e[:, None, 0], lever_y[j:], out=beyond)
            beyond -= e[:, None, 1] * lever_x[j:]
            if j:
                change_x = e[:, None, 1] * s[j, 2] - e[:, None, 2] * s[j, 1]
                change_y = e[:, None, 2] * s[j, 0] - e[:, None, 0] * s[j, 2]
                np.multiply(z[:j, 0], change_y, out=before)
                before -= z[:j, 1] * change_x
        return columns.reshape(2 * n, n, m)

    def base_columns(self, moments: FloatArray) -> FloatArray:
        """Return d tau / d tilt, shape (2, N, M), of the base about x and y."""
        z, s = self.frames[:, 2], self._carried(moments)
        return np.stack([z[:, 2] * s[:, 0] - z[:, 0] * s[:, 2],
                         z[:, 2] * s[:, 1] - z[:, 1] * s[:, 2]])

    def _carried(self, moments: FloatArray) -> FloatArray:
        """Return S_n (N, 3, M): the moments of link n and all beyond it, in the base."""
        rotated = self.rotated
        total = np.empty((len(rotated), *rotated.shape[2:]))
        for i in reversed(range(len(rotated))):
            np.multiply(moments[i, 0], rotated[i, 0], out=total[i])
            total[i] += moments[i, 1] * rotated[i, 1]
            if i + 1 < len(rotated):
                total[i] += total[i + 1]
        return total


def in_frames_of_axes(chain: Chain) -> Chain:
    """
    Return the same gravity in link frames that follow from the axes.

    The x axis of a link frame points to the axis before it, that of the first one to the vertical.
    A link with a parallel axis before it has the frame before it. So a link's moment on an arm
    with right angles is along x or y, and a payload changes few moments.
    """
    axes, moments = chain.axes.copy(), chain.moments.copy()
    for i in range(chain.n_joints):
        x, y, z = axes[i, 2]
        is_parallel = np.hypot(x, y) < abs(z)
        turn = axes[i].T @ aligned(axes[i, :, 2]) if is_parallel else about_z(np.arctan2(y, x))
        axes[i], moments[i] = axes[i] @ turn, moments[i] @ turn[:2, :2]
        if i + 1 < chain.n_joints:
            axes[i + 1] = turn.T @ axes[i + 1]
    return Chain(axes, moments)


def are_rotations(matrices: FloatArray) -> bool:
    """Return whether all matrices (K, 3, 3) are rotations."""
    error = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max()
    return bool(error <= 1e-6 and (np.linalg.det(matrices) >= 0.0).all())


def about_z(angle: FloatArray) -> FloatArray:
    """Return rotations (..., 3, 3) about z by angles (...) in rad."""
    rotation = np.zeros((*angle.shape, 3, 3))
    rotation[..., 0, 0] = rotation[..., 1, 1] = np.cos(angle)
    rotation[..., 1, 0] = np.sin(angle)
    rotation[..., 0, 1] = -rotation[..., 1, 0]
    rotation[..., 2, 2] = 1.0
    return rotation


def about(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation (3, 3) by an angle in rad about a unit vector (3,) (Rodrigues)."""
    cross = skew(axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def skew(v: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of v x for v (..., 3)."""
    upper = np.zeros((*v.shape[:-1], 3, 3))
    upper[..., 0, 1], upper[..., 0, 2], upper[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return upper - np.swapaxes(upper, -1, -2)


def tilt(d: FloatArray) -> FloatArray:
    """Return exp([d_x, d_y, 0]) for d (K, 2) in rad, shape (K, 3, 3)."""
    x, y = d.T
    angle = np.hypot(x, y)
    safe = np.maximum(angle, 1e-9)
    # Rodrigues: sin a / a and (1 - cos a) / a^2.
    first, second = np.sin(safe) / safe, 2.0 * (np.sin(0.5 * safe) / safe) ** 2
    result = np.empty((len(d), 3, 3))
    result[:, 0, 0], result[:, 1, 1] = 1.0 - second * y * y, 1.0 - second * x * x
    result[:, 0, 1] = result[:, 1, 0] = second * x * y
    result[:, 0, 2], result[:, 1, 2], result[:, 2, 2] = first * y, -first * x, np.cos(angle)
    result[:, 2, :2] = -result[:, :2, 2]
    return result


def aligned(direction: FloatArray) -> FloatArray:
    """Return the smallest rotation (3, 3) that takes the z axis to a unit vector (3,)."""
    x, y, z = direction
    sine = np.hypot(x, y)
    across = np.array([-y, x]) / sine if sine > 1e-12 else np.array([1.0, 0.0])
    return tilt((np.arctan2(sine, z) * across)[None])[0]


def expand(chain: Chain) -> Expansion:
    """
    Return U in J as a sparse sum over the dictionary.

    The vertical w_i is a sum over products of the factors of the first i joints. Each joint
    multiplies it by Rz.T A.T, which has one part for each factor 1, sin and cos.
    """
    vertical = np.array([[0.0, 0.0, 1.0]])
    energy = np.zeros(1)
    for axis, moment in zip(chain.axes, chain.moments):
        before = vertical @ axis
        x, y, z = before.T
        zero = np.zeros_like(x)
        parts = np.empty((len(before), 3, 3))
        parts[:, dictionary.ONE] = np.stack([zero, zero, z], axis=1)
        parts[:, dictionary.SIN] = np.stack([y, -x, zero], axis=1)
        parts[:, dictionary.COS] = np.stack([x, y, zero], axis=1)
        vertical = parts.reshape(-1, 3)
        grown = parts[:, :, :2] @ moment
        grown[:, dictionary.ONE] += energy
        energy = grown.ravel()
    energy[0] = 0.0  # a constant has no torque
    kept = np.flatnonzero(np.abs(energy) > _NEGLIGIBLE * np.abs(energy).max(initial=0.0))
    return Expansion(kept, energy[kept])
