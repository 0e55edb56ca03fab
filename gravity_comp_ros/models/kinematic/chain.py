"""
The structure of a serial arm, without its dimensions.

The potential energy of an arm of revolute joints is

    U = sum_i w_i . h_i,    w_i = Rz(q_i).T A_i.T w_{i-1},    w_0 = (0, 0, 1),

where w_i is the vertical as link i sees it, A_i a fixed rotation that says where the axis of
joint i lies in the frame of link i-1, and h_i the first moment about that axis of everything
that hangs on link i, times g, in N·m. It is the gradient of U that Yu 2022, Eq. (2) calls
gravity; lengths and masses enter it in the h_i alone.

Not all of this can be seen in the torques, so it is fixed: a turn of link frame i about its own
axis (A_i has two free angles, not three), a moment along an axis (it acts as one of link i-1 and
is counted there, so h_i has two numbers), a turn of the base about the vertical, and the sign of
the vertical with that of every moment. 4N numbers stand for the 3^N weights of the dictionary.

Rotations stay rotations: a step changes A_i to A_i exp([d_x, d_y, 0]), which has no singular
angle, parallel axes included.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
import numpy as np

# Poses whose frames are held at once: they fit into the cache of a processor.
_AT_ONCE = 8192


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
        off = np.abs(axes @ axes.transpose(0, 2, 1) - np.eye(3)).max()
        if off > 1e-6 or (np.linalg.det(axes) < 0.0).any():
            raise DataError('chain: an axis is not given by a rotation')
        object.__setattr__(self, 'axes', axes)
        object.__setattr__(self, 'moments', moments)

    @property
    def n_joints(self) -> int:
        return len(self.axes)

    def torque(self, q: FloatArray) -> FloatArray:
        """Return what holds the arm up, tau (M, N) in N·m, in poses q (M, N) in rad."""
        q = np.asarray(q, dtype=np.float64)
        parts = [ForwardKinematics(self.axes, q[start:start + _AT_ONCE]).torque(self.moments)
                 for start in range(0, max(len(q), 1), _AT_ONCE)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def moved(self, step: FloatArray) -> Chain:
        """Return the chain after a step (4N,): axes d (N, 2) in rad, then moments (N, 2)."""
        tilts, change = step.reshape(2, self.n_joints, 2)
        return Chain(self.axes @ tilt(tilts), self.moments + change)

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return d tau / d step (`moved`), shape (4N, N, M)."""
        sweep = ForwardKinematics(self.axes, np.asarray(q, dtype=np.float64))
        return np.concatenate([sweep.axis_columns(self.moments), sweep.moment_columns()])


class ForwardKinematics:
    """
    Every joint's frame in the base, at M poses.

    `frames` (N, 3, 3, M) holds the axes x, y and z of frame i before joint i turns, `turned` the
    same after it; z is the joint's axis. With S_n = sum_{i >= n} (moments of link i in the base)
    the torque is tau_n = e_z . (z_n x S_n).

    :param sin_cos: the sines and cosines (N, M) of q, if they are known.
    """

    def __init__(self, axes: FloatArray, q: FloatArray,
                 sin_cos: tuple[FloatArray, FloatArray] | None = None) -> None:
        n, m = len(axes), q.shape[0]
        sin, cos = (np.sin(q.T), np.cos(q.T)) if sin_cos is None else sin_cos
        self.frames, self.turned = np.empty((n, 3, 3, m)), np.empty((n, 3, 3, m))
        scratch = np.empty((3, m))
        for i in range(n):
            here, turned = self.frames[i], self.turned[i]
            if i:
                np.matmul(axes[i].T, self.turned[i - 1].reshape(3, 3 * m),
                          out=here.reshape(3, 3 * m))
            else:
                here[:] = axes[0].T[:, :, None]
            np.multiply(cos[i], here[:2], out=turned[:2])
            turned[0] += np.multiply(sin[i], here[1], out=scratch)
            turned[1] -= np.multiply(sin[i], here[0], out=scratch)
            turned[2] = here[2]

    def torque(self, moments: FloatArray) -> FloatArray:
        """Return the torque (M, N) of moments (N, 2) on these axes."""
        hanging, z = self._hanging(moments), self.frames[:, 2]
        return np.asarray((z[:, 0] * hanging[:, 1] - z[:, 1] * hanging[:, 0]).T)

    def moment_columns(self, along: int = 2, weights: FloatArray | None = None) -> FloatArray:
        """
        Return d tau / d h, shape (2N, N, M): e_z . (z_n x a) for each moment's axis a.

        :param along: 0 or 1 for a force along x or y of the base in the place of gravity.
        :param weights: (N, M) that the torques are multiplied by.
        """
        n, _, _, m = self.frames.shape
        i, j = (along + 1) % 3, (along + 2) % 3
        z, a = self._weighted(self.frames[:, 2], weights), self.turned
        columns = np.zeros((n, 2, n, m))
        for k in range(n):
            # A link turns about the joints before it and about its own.
            part = columns[k, :, :k + 1]
            np.multiply(z[:k + 1, i], a[k, :2, None, j], out=part)
            part -= z[:k + 1, j] * a[k, :2, None, i]
        return columns.reshape(2 * n, n, m)

    def axis_columns(self, moments: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """
        Return d tau / d d, shape (2N, N, M): what turning A_j about its own x or y does.

        All that hangs on joint j turns about e, so that for n >= j the vertical turns the
        other way, tau_n' = (e_z x e) . (z_n x S_n), and for n < j only the moments beyond j
        turn, tau_n' = e_z . (z_n x (e x S_j)).

        :param weights: (N, M) that the torques are multiplied by.
        """
        n, _, _, m = self.frames.shape
        z, s = self._weighted(self.frames[:, 2], weights), self._hanging(moments)
        lever_x = z[:, 1] * s[:, 2] - z[:, 2] * s[:, 1]
        lever_y = z[:, 2] * s[:, 0] - z[:, 0] * s[:, 2]
        columns = np.empty((n, 2, n, m))
        for j in range(n):
            e = self.frames[j, :2]
            beyond, before = columns[j, :, j:], columns[j, :, :j]
            np.multiply(e[:, None, 0], lever_y[j:], out=beyond)
            beyond -= e[:, None, 1] * lever_x[j:]
            if j:
                turned_x = e[:, None, 1] * s[j, 2] - e[:, None, 2] * s[j, 1]
                turned_y = e[:, None, 2] * s[j, 0] - e[:, None, 0] * s[j, 2]
                np.multiply(z[:j, 0], turned_y, out=before)
                before -= z[:j, 1] * turned_x
        return columns.reshape(2 * n, n, m)

    @staticmethod
    def _weighted(z: FloatArray, weights: FloatArray | None) -> FloatArray:
        return z if weights is None else z * weights[:, None]

    def _hanging(self, moments: FloatArray) -> FloatArray:
        """Return S_n (N, 3, M): the moments of link n and all beyond it, in the base."""
        turned = self.turned
        total = np.empty((len(turned), *turned.shape[2:]))
        for i in reversed(range(len(turned))):
            np.multiply(moments[i, 0], turned[i, 0], out=total[i])
            total[i] += moments[i, 1] * turned[i, 1]
            if i + 1 < len(turned):
                total[i] += total[i + 1]
        return total


def tilt(d: FloatArray) -> FloatArray:
    """Return exp([d_x, d_y, 0]) for d (K, 2) in rad, shape (K, 3, 3)."""
    x, y = d[:, 0], d[:, 1]
    angle = np.hypot(x, y)
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    zero = np.zeros_like(x)
    skew = np.moveaxis(np.array([[zero, zero, y], [zero, zero, -x], [-y, x, zero]]), 2, 0)
    return np.eye(3) + first[:, None, None] * skew + second[:, None, None] * (skew @ skew)


def aligned(direction: FloatArray) -> FloatArray:
    """Return the least rotation that turns the z axis into a unit vector (3,)."""
    x, y, z = direction
    sine = np.hypot(x, y)
    across = np.array([-y, x]) / sine if sine > 1e-12 else np.array([1.0, 0.0])
    return tilt((np.arctan2(sine, z) * across)[None])[0]
