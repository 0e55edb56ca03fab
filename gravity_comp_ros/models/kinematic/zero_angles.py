"""
Where joints count their angles from, for an arm with known axes.

An encoder that was set to zero by eye is a degree away from the description's zero, and a degree
of the elbow moves the torque of the shoulder by percents. A chain with zero angles d has the
torque tau(q + d), so that a step of them is d tau / d q. The first joint turns about the vertical
and the last one turns its own moments: neither shows. A tilt of the base, which turns all torques
a little as well, is fitted beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.noise import correlation_time
import numpy as np

# Two samples in a row count as one, and all of them as so many: more say more of the noise, not of
# what the description and the terms beside gravity lack.
_ALIKE, _WORTH = 2.0, 125.0
# rad: what zero angles usually are off by, and the most that is believed.
_USUAL, _MOST = np.radians(1.5), np.radians(15.0)
# Other zero angles must be this much likelier (natural logarithm).
_LIKELIER = 6.0
_ROUNDS, _SETTLED = 10, 1e-5
# Residuals beyond so many RMS are left out.
_OUTLIER = 4.0
# rad: the step of a derivative.
_STEP = 1e-4
# What is left of a joint counts as no less than this share of the largest torque.
_LEAST = 1e-4
# One axis lies along another up to this (1 minus the cosine).
_SAME = 1e-9
# Directions that the motion excites less, next to the most excited, are left out.
_EXCITED = 1e-4


def with_zero_angles(geometry: Geometry, samples: JointSamples) -> Geometry:
    """
    Return the geometry with the zero angles that the torque shows, unchanged if it shows none.

    :param geometry: the axes of the samples' joints, in their order.
    :param samples: some hundred are enough.
    """
    if geometry.n_joints < 3 or not samples.tau.any():
        return geometry
    angles, likelier = _Problem.of(geometry, samples).solve()
    if likelier < _LIKELIER or np.abs(angles).max() > _MOST:
        return geometry
    return replace(geometry, rotations=geometry.rotations @ _about_z(angles))


def same_axes(geometry: Geometry, other: Geometry) -> bool:
    """Return whether two geometries are of one arm, but for its vertical and its zero angles."""
    if geometry.joints != other.joints:
        return False
    along = np.einsum('nji,njk->nik', geometry.rotations, other.rotations)[1:, 2, 2]
    return bool((along > 1.0 - _SAME).all())


def angles_between(rotations: FloatArray, others: FloatArray) -> FloatArray:
    """Return by how much (N,) in rad joints of `others` count from elsewhere; both (N, 3, 3)."""
    turn = rotations.transpose(0, 2, 1) @ others
    return np.asarray(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Poses `q` (M, N), their torque, and `beside` (K, N, M): offset and friction of a joint."""

    rotations: FloatArray
    q: FloatArray
    tau: FloatArray
    beside: FloatArray
    runs: IntArray

    @classmethod
    def of(cls, geometry: Geometry, samples: JointSamples) -> _Problem:
        qd, each = samples.qd.T, np.eye(samples.n_joints)[:, :, None]
        beside = np.concatenate([each * np.ones_like(qd), each * np.sign(qd), each * qd])
        return cls(geometry.rotations, samples.q, samples.tau, beside, samples.runs)

    def solve(self) -> tuple[FloatArray, float]:
        """Return the likeliest zero angles (N,) in rad, and by how much they are than none."""
        n = self.q.shape[1]
        angles, inner, up = np.zeros(n), np.arange(1, n - 1), np.array([0.0, 0.0, 1.0])
        columns = np.concatenate([self._along(angles)[2], self.beside])
        found = self._plain(columns, self._usual())
        weights = self._weights(self._left(columns, found))
        for _ in range(_ROUNDS):
            columns = self._columns(angles, up, found[:2 * n])
            found = self._plain(columns, weights)
            turns = np.stack([self._turn(angles, up, joint, found[:2 * n]) for joint in inner])
            step = self._step(columns, turns, weights, angles[inner])
            angles[inner] += step
            up = up + [*found[-2:], 0.0]
            left = self._left(columns, found)
            weights = self._weights(left)
            if np.abs(step).max() < _SETTLED:
                break
        return angles, self._evidence(columns, turns, self._cautious(weights, left),
                                      angles[inner])

    def _usual(self) -> FloatArray:
        size = self.tau.std(axis=0)
        return np.ones(self.tau.shape) / np.maximum(size, 1e-2 * size.max() + 1e-12)

    def _weights(self, left: FloatArray) -> FloatArray:
        """Return one over what is left of each joint (M, N), 0 for outliers."""
        inside = np.abs(left) <= _OUTLIER * np.sqrt((left ** 2).mean(axis=0))
        size = np.sqrt((left ** 2 * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1))
        least = _LEAST * np.abs(self.tau).max()
        return np.asarray(inside / (np.sqrt(self._alike()) * np.maximum(size, least)))

    def _alike(self) -> float:
        return max(_ALIKE, len(self.q) / _WORTH)

    def _cautious(self, weights: FloatArray, left: FloatArray) -> FloatArray:
        """Return smaller weights (M, N) where the residual is correlated: an effect is missing."""
        times = np.array([correlation_time(column, self.runs) for column in left.T])
        return np.asarray(weights / np.sqrt(np.maximum(times / self._alike(), 1.0)))

    def _plain(self, columns: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the coefficients of moments and terms beside, the angles as they are."""
        return lstsq(self._rows(columns, weights).T, (self.tau * weights).T.ravel(),
                     rcond=_EXCITED)

    def _step(self, columns: FloatArray, turns: FloatArray, weights: FloatArray,
              angles: FloatArray) -> FloatArray:
        """Return a Gauss-Newton step (F,) of the angles, whose prior stands where they began."""
        d, left = self._projected(columns, turns, weights)
        return np.asarray(np.linalg.solve(d @ d.T + np.eye(len(d)) / _USUAL ** 2,
                                          d @ left - angles / _USUAL ** 2))

    def _projected(self, columns: FloatArray, turns: FloatArray, weights: FloatArray
                   ) -> tuple[FloatArray, FloatArray]:
        """Return the angles' rows (F, N M) and the torque (N M,) beside moments and friction."""
        rows = self._rows(columns, weights)
        every = self._rows(np.concatenate([turns, self.tau.T[None]]), weights)
        every = every - (rows.T @ lstsq(rows.T, every.T, rcond=_EXCITED)).T
        return every[:-1], every[-1]

    def _evidence(self, columns: FloatArray, turns: FloatArray, weights: FloatArray,
                  angles: FloatArray) -> float:
        """Return the log evidence of the angles over none, torque being linear in them."""
        d, left = self._projected(columns, turns, weights)
        begun = left + angles @ d
        spread = np.eye(len(d)) + _USUAL ** 2 * d @ d.T
        gained = begun @ begun - left @ left - angles @ angles / _USUAL ** 2
        return float(0.5 * (gained - np.linalg.slogdet(spread)[1]))

    def _left(self, columns: FloatArray, found: FloatArray) -> FloatArray:
        return np.asarray(self.tau - np.tensordot(found, columns, axes=(0, 0)).T)

    def _along(self, angles: FloatArray) -> FloatArray:
        """Return the torque (3, 2N, N, M) per moment for a vertical along each of the axes."""
        sweep = ForwardKinematics(self.rotations, self.q + angles)
        return np.stack([sweep.moment_columns(axis) for axis in range(3)])

    def _columns(self, angles: FloatArray, up: FloatArray, moments: FloatArray) -> FloatArray:
        """Return columns (C, N, M) of moments, offsets, friction, and the vertical's x and y."""
        along = self._along(angles)
        tilts = np.tensordot(moments, along[:2], axes=(0, 1))
        return np.concatenate([np.tensordot(up, along, axes=1), self.beside, tilts])

    def _turn(self, angles: FloatArray, up: FloatArray, joint: int, moments: FloatArray
              ) -> FloatArray:
        """Return d torque / d angle (N, M) of one joint."""
        step = _STEP * np.eye(len(angles))[joint]
        ahead, behind = (
            np.tensordot(np.outer(up, moments), self._along(angles + way * step), axes=2)
            for way in (1.0, -1.0))
        return np.asarray((ahead - behind) / (2.0 * _STEP))

    def _rows(self, columns: FloatArray, weights: FloatArray) -> FloatArray:
        """Return columns (K, N, M) in units of what is left, (K, N M)."""
        return np.asarray((columns * weights.T).reshape(len(columns), -1))


def _about_z(angles: FloatArray) -> FloatArray:
    """Return rotations (N, 3, 3) about z by angles (N,) in rad."""
    found = np.tile(np.eye(3), (len(angles), 1, 1))
    found[:, 0, 0] = found[:, 1, 1] = np.cos(angles)
    found[:, 1, 0] = np.sin(angles)
    found[:, 0, 1] = -found[:, 1, 0]
    return found
