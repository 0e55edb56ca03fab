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

from gravity_comp_ros.data.samples import BoolArray, FloatArray
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

    `x`, `y`, `z` (N, 3, M) are the axes of frame i before joint i turns, `turned_x`, `turned_y`
    after it; z is the joint's axis. With S_n = sum_{i >= n} (moments of link i in the base) the
    torque is tau_n = e_z . (z_n x S_n).
    """

    def __init__(self, axes: FloatArray, q: FloatArray) -> None:
        n, m = len(axes), q.shape[0]
        sin, cos = np.sin(q.T), np.cos(q.T)
        self.x, self.y, self.z = (np.empty((n, 3, m)) for _ in range(3))
        self.turned_x, self.turned_y = np.empty((n, 3, m)), np.empty((n, 3, m))
        frame = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, m)).reshape(3, 3 * m)
        for i in range(n):
            x, y, z = (axes[i].T @ frame).reshape(3, 3, m)
            self.x[i], self.y[i], self.z[i] = x, y, z
            turned = np.empty((3, 3, m))
            turned[0] = cos[i] * x + sin[i] * y
            turned[1] = cos[i] * y - sin[i] * x
            turned[2] = z
            self.turned_x[i], self.turned_y[i] = turned[0], turned[1]
            frame = turned.reshape(3, 3 * m)

    def torque(self, moments: FloatArray) -> FloatArray:
        """Return the torque (M, N) of moments (N, 2) on these axes."""
        hanging, z = self._hanging(moments), self.z
        return np.asarray((z[:, 0] * hanging[:, 1] - z[:, 1] * hanging[:, 0]).T)

    def moment_columns(self, along: int = 2) -> FloatArray:
        """
        Return d tau / d h, shape (2N, N, M): e_z . (z_n x a) for each moment's axis a.

        :param along: 0 or 1 for a force along x or y of the base in the place of gravity.
        """
        n, _, m = self.z.shape
        a = np.stack([self.turned_x, self.turned_y], axis=1)
        i, j = (along + 1) % 3, (along + 2) % 3
        columns = self.z[:, i] * a[:, :, None, j] - self.z[:, j] * a[:, :, None, i]
        # A link turns about the joints before it and about its own.
        return np.asarray((columns * _at_or_beyond(n).T[:, None, :, None]).reshape(2 * n, n, m))

    def axis_columns(self, moments: FloatArray) -> FloatArray:
        """
        Return d tau / d d, shape (2N, N, M): what turning A_j about its own x or y does.

        All that hangs on joint j turns about e, so that for n >= j the vertical turns the
        other way, tau_n' = (e_z x e) . (z_n x S_n), and for n < j only the moments beyond j
        turn, tau_n' = e_z . (z_n x (e x S_j)).
        """
        n, _, m = self.z.shape
        hanging = self._hanging(moments)
        z, s = self.z, hanging
        lever_x = z[:, 1] * s[:, 2] - z[:, 2] * s[:, 1]
        lever_y = z[:, 2] * s[:, 0] - z[:, 0] * s[:, 2]
        e = np.stack([self.x, self.y], axis=1)
        s = s[:, None]
        turned_x = e[:, :, 1] * s[:, :, 2] - e[:, :, 2] * s[:, :, 1]
        turned_y = e[:, :, 2] * s[:, :, 0] - e[:, :, 0] * s[:, :, 2]
        beyond = e[:, :, None, 0] * lever_y - e[:, :, None, 1] * lever_x
        before = z[:, 0] * turned_y[:, :, None] - z[:, 1] * turned_x[:, :, None]
        columns = np.where(_at_or_beyond(n)[:, None, :, None], beyond, before)
        return np.asarray(columns.reshape(2 * n, n, m))

    def _hanging(self, moments: FloatArray) -> FloatArray:
        """Return S_n (N, 3, M): the moments of link n and all beyond it, in the base."""
        each = (moments[:, 0, None, None] * self.turned_x
                + moments[:, 1, None, None] * self.turned_y)
        return np.cumsum(each[::-1], axis=0)[::-1]


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


def _at_or_beyond(n: int) -> BoolArray:
    """Return a mask (N, N): whether the joint of the column is that of the row, or beyond it."""
    return np.triu(np.ones((n, n), dtype=bool))
