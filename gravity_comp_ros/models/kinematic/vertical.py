"""
Which way is up for an arm with known axes: on a wall, an incline or a ceiling.

A description often stands upright where the arm does not. Its torque is linear in the moments and
linear in the vertical's three numbers, so that one sum of products serves for every vertical. They
are tried on a grid over half of the sphere, then refined. The other half has the same torques,
with negative moments: there a nominal arm decides, whose masses are not negative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import out_of_reach
import numpy as np

# Samples that are looked at, and about how many of them in a row count as one.
_POSES, _ALIKE = 150, 4.0
# Verticals on half of the sphere, about 13 degrees apart, and how many are refined.
_GRID, _REFINED = 128, 4
# rad: what a fit finds by itself, beginning from the description's vertical.
NEAR = np.radians(20.0)
# rad: the first and the last step of a refinement.
_FIRST_STEP, _LAST_STEP = np.radians(8.0), np.radians(0.2)
# Another vertical must take this share off some joint's RMSE, and be this much likelier (natural
# logarithm): an effect that is not modelled looks a little like a turn as well.
_MUCH, _LIKELIER = 0.3, 12.0
# Directions that the motion excites less than this, next to the most excited, are damped.
_DAMPED = 1e-4
# A joint with less torque than this share of the largest counts as one with that.
_LEAST = 1e-2
# An arm stands the other way up if masses then miss less than this share of what they miss of its
# moments. Of three real arms they miss 1 to 8 %, and 72 to 99 % the wrong way up; of arms drawn at
# random 10 to 30 % and 30 to 80 %. One of 180 poor recordings of upright arms was turned over.
_UPSIDE_DOWN = 0.7


def on_vertical(geometry: Geometry, samples: JointSamples) -> Geometry:
    """
    Return the geometry with its base turned as the torque shows it, unturned where that is nearly.

    :param geometry: the axes of the samples' joints, in their order.
    """
    if geometry.n_joints < 2:
        return geometry
    torques = _Torques.of(geometry, samples)
    vertical = torques.best()
    moments = torques.moments(vertical) / STANDARD_GRAVITY
    turned = replace(geometry, rotations=_turned(geometry.rotations, vertical))
    over = replace(geometry, rotations=_turned(geometry.rotations, -vertical))
    if out_of_reach(over, -moments) < _UPSIDE_DOWN * out_of_reach(turned, moments):
        return over
    return turned if vertical[2] < np.cos(NEAR) else geometry


def angle_between(rotations: FloatArray, others: FloatArray) -> float:
    """Return the angle in rad between the verticals of two arms, from their axes (N, 3, 3)."""
    one, other = rotations[0][2], others[0][2]
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


@dataclass(frozen=True, eq=False)
class _Torques:
    """
    Sums of products of each joint's torque and its columns.

    `products` (N, C, C), `right` (N, C) and `squares` (N,). The columns C are 2 N moments for a
    vertical along each of the base's axes, then an offset and dry friction of each joint.
    """

    products: FloatArray
    right: FloatArray
    squares: FloatArray
    n_samples: int

    @classmethod
    def of(cls, geometry: Geometry, samples: JointSamples) -> _Torques:
        rows, n = evenly_picked(samples.n_samples, _POSES), samples.n_joints
        q, tau = samples.q[rows], samples.tau[rows]
        sweep = ForwardKinematics(geometry.rotations, q)
        beside = np.zeros((2 * n, n, len(q)))
        for joint in range(n):
            beside[2 * joint, joint] = 1.0
            beside[2 * joint + 1, joint] = np.sign(samples.qd[rows, joint])
        columns = np.concatenate([*(sweep.moment_columns(axis) for axis in range(3)), beside])
        columns = columns.transpose(1, 0, 2)
        return cls(columns @ columns.transpose(0, 2, 1), np.einsum('ncm,mn->nc', columns, tau),
                   (tau ** 2).sum(axis=0), len(q))

    def best(self) -> FloatArray:
        """Return the vertical (3,) in the base, near its z if nothing else is much likelier."""
        up = np.array([0.0, 0.0, 1.0])
        # Each joint by what it leaves, so that one of much noise hides no other.
        weights = self._weights(self._left(up[None], self._weights())[0])
        level = self._left(up[None], weights)[0]
        near = self._refined(up, weights, NEAR)
        left = self._left(near[None], weights)[0]
        if not self._is_likelier(left, level):
            # Next to level, moments about the first axis could have any size.
            near, left = up, level
        weights = self._weights(left)
        grid = _half_sphere()
        cost = (self._left(grid, weights) * weights).sum(axis=1)
        ends = [self._refined(grid[k], weights) for k in np.argsort(cost)[:_REFINED]]
        rest = self._left(np.array(ends), weights)
        first = int((rest * weights).sum(axis=1).argmin())
        found = ends[first]
        return found if found[2] < np.cos(NEAR) and self._is_likelier(rest[first], left) else near

    def _is_likelier(self, left: FloatArray, before: FloatArray) -> bool:
        """Return whether joints keep (N,) so much less of their squares than before."""
        ratio = np.log(self._weights(before) / self._weights(left))
        gained = -0.5 * self.n_samples / _ALIKE * float(ratio.sum())
        return gained > _LIKELIER and 0.5 * float(ratio.min()) < np.log(1.0 - _MUCH)

    def moments(self, vertical: FloatArray) -> FloatArray:
        """Return the moments (N, 2) in N·m that fit best with a vertical (3,)."""
        n = len(self.squares)
        found = self._solved(vertical[None], self._weights())[0]
        return np.asarray(found[0, :2 * n].reshape(n, 2))

    def _weights(self, left: FloatArray | None = None) -> FloatArray:
        """Return the weight of each joint (N,), by its torque or by what a fit leaves of it."""
        if left is None:
            return np.asarray(1.0 / np.maximum(self.squares, _LEAST ** 2 * self.squares.max()))
        return np.asarray(1.0 / np.maximum(left, 1e-9 * self.squares.max() + 1e-12))

    def _refined(self, start: FloatArray, weights: FloatArray,
                 reach: float = np.pi) -> FloatArray:
        """Return the best vertical (3,) that steps downhill lead to, within reach of the start."""
        found, step = start, _FIRST_STEP
        least = float((self._left(found[None], weights) * weights).sum())
        while step > _LAST_STEP:
            around = _around(found, step)
            around = around[around @ start > np.cos(reach) + 1e-9]
            cost = (self._left(around, weights) * weights).sum(axis=1)
            if cost.size and cost.min() < least:
                found, least = around[cost.argmin()], float(cost.min())
            else:
                step *= 0.5
        return found

    def _left(self, verticals: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the sum of squares (V, N) that each joint keeps, for verticals (V, 3)."""
        found, columns = self._solved(verticals, weights)
        inner = np.einsum('vc,nvc->vn', found, 2.0 * columns.right)
        quadratic = np.einsum('vc,nvcd,vd->vn', found, columns.products, found)
        return np.asarray(np.maximum(self.squares - inner + quadratic, 0.0))

    def _solved(self, verticals: FloatArray, weights: FloatArray) -> tuple[FloatArray, _Reduced]:
        """Return coefficients (V, 2 N + K) of the moments, offsets and dry friction."""
        columns = self._reduced(verticals)
        products = np.tensordot(weights, columns.products, axes=1)
        right = np.tensordot(weights, columns.right, axes=1)
        size = np.trace(products, axis1=1, axis2=2) / products.shape[1]
        damped = products + (_DAMPED ** 2 * size)[:, None, None] * np.eye(products.shape[1])
        return np.linalg.solve(damped, right[:, :, None])[:, :, 0], columns

    def _reduced(self, verticals: FloatArray) -> _Reduced:
        """Return the sums of products for each of the verticals (V, 3)."""
        n = len(self.squares)
        split = 6 * n
        gravity = self.products[:, :split, :split].reshape(n, 3, 2 * n, 3, 2 * n)
        cross = self.products[:, :split, split:].reshape(n, 3, 2 * n, -1)
        beside = self.products[:, split:, split:]
        v = len(verticals)
        top = np.einsum('va,nacbd,vb->nvcd', verticals, gravity, verticals, optimize=True)
        side = np.einsum('va,nack->nvck', verticals, cross)
        rest = np.broadcast_to(beside[:, None], (n, v, *beside.shape[1:]))
        products = np.concatenate([
            np.concatenate([top, side], axis=3),
            np.concatenate([side.transpose(0, 1, 3, 2), rest], axis=3)], axis=2)
        right = np.concatenate([
            np.einsum('va,nac->nvc', verticals, self.right[:, :split].reshape(n, 3, 2 * n)),
            np.broadcast_to(self.right[:, None, split:], (n, v, 2 * n))], axis=2)
        return _Reduced(products, right)


@dataclass(frozen=True, eq=False)
class _Reduced:
    """Sums of products (N, V, C, C) and (N, V, C) of one joint's torque for one vertical."""

    products: FloatArray
    right: FloatArray


def _half_sphere() -> FloatArray:
    """Return verticals (V, 3), evenly spread over the upper half: a spiral of golden angles."""
    z = 1.0 - (np.arange(_GRID) + 0.5) / _GRID
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_GRID)
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def _around(vertical: FloatArray, step: float) -> FloatArray:
    """Return six verticals (6, 3) at an angle from one."""
    side = np.cross(vertical, np.eye(3)[np.abs(vertical).argmin()])
    side /= np.linalg.norm(side)
    other = np.cross(vertical, side)
    angle = np.pi / 3.0 * np.arange(6)[:, None]
    around = np.cos(angle) * side + np.sin(angle) * other
    return np.asarray(np.cos(step) * vertical + np.sin(step) * around)


def _turned(rotations: FloatArray, vertical: FloatArray) -> FloatArray:
    """Return the axes (N, 3, 3) with the base turned so that a vertical of it is up."""
    up = np.array([0.0, 0.0, 1.0])
    found = rotations.copy()
    if vertical[2] < -1.0 + 1e-12:
        found[0] = np.diag([1.0, -1.0, -1.0]) @ rotations[0]
        return found
    axis = np.cross(vertical, up)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]],
                      [-axis[1], axis[0], 0.0]])
    found[0] = (np.eye(3) + cross + cross @ cross / (1.0 + vertical[2])) @ rotations[0]
    return found
