"""
Possible faults of a robot description, each with its parameters.

A fault changes the arm (`FaultyArm`) as a function of up to four parameters with a prior standard
deviation. `starts` are the values from which a search begins: an angle by a quarter turn is far
from no fault.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.kinematic.chain import about_z, ForwardKinematics, tilt
import numpy as np

AXIS_REVERSED, AXIS_TURNED, ZERO, ORDER = 'axis_reversed', 'axis_turned', 'zero_angle', 'order'
MOUNT, GAIN, UNIT, MASS, BODY = 'mount', 'effort_scale', 'effort_unit', 'mass', 'body'
KINDS = (AXIS_REVERSED, AXIS_TURNED, ZERO, ORDER, MOUNT, GAIN, UNIT, MASS, BODY)
_QUARTER = 0.5 * np.pi
_TURNS = np.array([[0.0, 0.0], [_QUARTER, 0.0], [-_QUARTER, 0.0], [0.0, _QUARTER],
                   [0.0, -_QUARTER]])
# Scale and starts of a fault without parameters.
_NONE = np.zeros(0), np.zeros((1, 0))
# Factors of efforts in another unit are near one of these: mN·m, N·cm, kgf·cm, percent, kgf·m.
_UNITS = (1.0, 10.0, 100.0, 1000.0, 0.1, 0.01)


@dataclass(frozen=True, eq=False)
class FaultyArm:
    """
    A serial arm of N joints, as the recording reports it.

    `rotations`, `origins` as in `Geometry`; `bodies` (N, 4) are mass in kg and first moment in
    kg m of all links of each frame. The torque about axis i is recorded with the factor `gains`.
    `order` (N,) is the column of the recording that belongs to axis i.
    """

    rotations: FloatArray
    origins: FloatArray
    bodies: FloatArray
    gains: FloatArray
    order: IntArray

    @classmethod
    def described(cls, rotations: FloatArray, origins: FloatArray,
                  bodies: FloatArray) -> FaultyArm:
        """Return the arm as described."""
        n = len(rotations)
        return cls(rotations, origins, bodies, np.ones(n), np.arange(n))

    def recorded(self, torque: FloatArray) -> FloatArray:
        """Return the torque (M, N) as recorded, from that about the axes."""
        result = np.empty_like(torque)
        result[:, self.order] = self.gains * torque
        return result

    def gravity(self, q: FloatArray) -> FloatArray:
        """Return the recorded gravity torque (M, N) in N·m at recorded angles (M, N)."""
        n, moments = len(self.bodies), self.bodies[:, 1:].copy()
        # Every link carries those beyond it at the end of its length.
        moments[:-1] += np.cumsum(self.bodies[:0:-1, 0])[::-1, None] * self.origins[1:]
        for i in range(n - 1, 0, -1):
            # A moment along an axis acts as a moment of the link before.
            moments[i - 1] += moments[i, 2] * self.rotations[i][:, 2]
        return self.recorded(ForwardKinematics(self.rotations, q[:, self.order]).torque(
            STANDARD_GRAVITY * moments))

    def turned_axis(self, joint: int, turn: FloatArray) -> FaultyArm:
        """Return the arm with the axis of a joint turned by a rotation (3, 3) of its frame."""
        rotations, origins, bodies = (self.rotations.copy(), self.origins.copy(),
                                      self.bodies.copy())
        rotations[joint] = rotations[joint] @ turn
        # At angle 0 the links stay where they are.
        bodies[joint, 1:] = turn.T @ bodies[joint, 1:]
        if joint + 1 < len(rotations):
            rotations[joint + 1] = turn.T @ rotations[joint + 1]
            origins[joint + 1] = turn.T @ origins[joint + 1]
        return replace(self, rotations=rotations, origins=origins, bodies=bodies)

    def turned_frame(self, joint: int, turn: FloatArray) -> FaultyArm:
        """Return the arm with the frame of a joint, and all links beyond, turned: R_i turn."""
        rotations = self.rotations.copy()
        rotations[joint] = rotations[joint] @ turn
        return replace(self, rotations=rotations)

    def with_body(self, joint: int, change: FloatArray) -> FaultyArm:
        """Return the arm with mass and first moment (4,) added to a frame."""
        bodies = self.bodies.copy()
        bodies[joint] = bodies[joint] + change
        return replace(self, bodies=bodies)


@dataclass(frozen=True)
class CheckOptions:
    """
    Options of a check.

    - `discrepancy`: share of a joint's torque range that no rigid arm explains, and
      `friction_discrepancy` that of its friction that no sum of laws explains (Stribeck
      friction, load), as standard deviations.
    - `max_faults` bounds the search. A fault has the least log evidence of a term of the
      regression (`EngineOptions.min_gain`).
    - `unchecked`, rad: standard deviation beyond which an angle counts as not checked.
    - `smaller`: ratio of standard deviations without and with the faults found below which they
      are searched again.
    - `angle`, rad, and `factor`: prior standard deviations of angles, and of factors, masses and
      first moments relative to those of the arm beyond the joint, which are at least `min_mass`,
      kg, at `min_lever`, m.

    :raises OptionError: if a number is not positive.
    """

    discrepancy: float = 0.005
    friction_discrepancy: float = 0.3
    max_faults: int = 4
    unchecked: float = 0.05
    smaller: float = 0.9
    angle: float = 0.3
    factor: float = 0.5
    min_mass: float = 0.2
    min_lever: float = 0.1

    def __post_init__(self) -> None:
        check_positive(self, 'check of a description')


@dataclass(frozen=True, eq=False)
class Fault:
    """
    A possible fault.

    `subjects` are the joints or links. `change` returns the arm with parameters (P,); `scale`
    (P,) is their prior standard deviation about each start of `starts` (K, P). A fault without
    parameters has P = 0.
    """

    kind: str
    subjects: tuple[str, ...]
    scale: FloatArray
    starts: FloatArray
    change: Callable[[FaultyArm, FloatArray], FaultyArm]

    @property
    def size(self) -> int:
        return len(self.scale)


def possible_faults(arm: FaultyArm, joints: tuple[str, ...],
                    links: dict[str, tuple[int, FloatArray]],
                    options: CheckOptions) -> list[Fault]:
    """
    Return all faults that are compared.

    :param links: by name, the frame of a link and its mass and first moment there (4,).
    """
    factor = np.array([options.factor])
    faults = [Fault(MOUNT, ('base',), np.full(2, options.angle), np.array([*_TURNS, [np.pi, 0.0]]),
                    lambda arm, p: replace(arm, rotations=np.concatenate([
                        tilt(p[None]) @ arm.rotations[:1], arm.rotations[1:]])))]
    faults += [Fault(UNIT, ('all joints',), factor * size, np.array([[size], [-size]]),
                     lambda arm, p: replace(arm, gains=arm.gains * p[0])) for size in _UNITS]
    for n, joint in enumerate(joints):
        faults += _of_joint(arm, n, joint, options)
        faults += [_swapped(n, m, joint, joints[m]) for m in range(n)]
    return faults + [_mass(link, *place, factor) for link, place in links.items()]


def _of_joint(described: FaultyArm, n: int, joint: str, options: CheckOptions) -> list[Fault]:
    """Return the faults of one joint alone."""
    mass = max(float(described.bodies[n:, 0].sum()), options.min_mass)
    lever = max(options.min_lever,
                float(np.linalg.norm(described.origins[n + 1:], axis=1).sum()))
    return [
        Fault(AXIS_REVERSED, (joint,), *_NONE,
              lambda arm, _: arm.turned_axis(n, np.diag([1.0, -1.0, -1.0]))),
        Fault(ZERO, (joint,), np.array([options.angle]),
              np.array([[0.0], [_QUARTER], [-_QUARTER], [np.pi]]),
              lambda arm, p: arm.turned_frame(n, about_z(p[0]))),
        Fault(AXIS_TURNED, (joint,), np.full(2, options.angle), _TURNS,
              lambda arm, p: arm.turned_axis(n, tilt(p[None])[0])),
        Fault(GAIN, (joint,), np.array([options.factor]), np.array([[1.0], [-1.0]]),
              lambda arm, p: replace(arm, gains=np.where(
                  arm.order == arm.order[n], p[0] * arm.gains, arm.gains))),
        Fault(BODY, (joint,), options.factor * mass * np.array([1.0, lever, lever, lever]),
              np.zeros((1, 4)), lambda arm, p: arm.with_body(n, p))]


def _swapped(n: int, m: int, joint: str, other: str) -> Fault:
    def change(arm: FaultyArm, _: FloatArray) -> FaultyArm:
        order = arm.order.copy()
        order[[n, m]] = order[[m, n]]
        return replace(arm, order=order)

    return Fault(ORDER, (other, joint), *_NONE, change)


def _mass(link: str, frame: int, body: FloatArray, factor: FloatArray) -> Fault:
    return Fault(MASS, (link,), factor, np.array([[0.0]]),
                 lambda arm, p: arm.with_body(frame, p[0] * body))
