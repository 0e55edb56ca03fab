"""Motion of a recording: quantities from which effect columns are computed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.acceleration import AccelerationOptions, accelerations
from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.motion_direction import direction, find_shape, min_widths, Shape
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
import numpy as np


@dataclass(frozen=True)
class Motion:
    """
    Quantities from which effect columns are computed.

    - `samples`: measured q, qd and tau of all runs.
    - `qdd` (M, N) in rad/s^2: estimated acceleration.
    - `gravity` (M, N) in N·m: torque predicted by the gravity model.
    - `known_gradient`: `gradient`, if it is known without the model.
    - `sign_width` (N,) in rad/s: speed over which the friction of a joint changes its sign.
    - `model`: the gravity model, for effects derived from its terms.
    - `hold` (N,) in rad: distance over which the direction of a joint reverses if its friction
      persists at rest; 0 (default) for a joint without friction at rest.
    - `ramp` (N,): whether the direction of a joint is a ramp (`motion_direction`); by default not.
    - `chain`: the serial arm fitted to gravity, if `model` has none.
    - `directions`: cached directions by joint, independent of the gravity model.
    - `memo`: cache for results that are the same for all settings of an effect.
    """

    samples: JointSamples
    qdd: FloatArray
    gravity: FloatArray
    known_gradient: FloatArray | None
    sign_width: FloatArray
    model: GravityModel | None = None
    hold: FloatArray | None = None
    chain: Chain | None = None
    ramp: FloatArray | None = None
    directions: dict[int, FloatArray] = field(default_factory=dict, repr=False, compare=False)
    memo: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False,
                                        compare=False)

    @property
    def serial_arm(self) -> Chain | None:
        """Return the serial arm fitted to gravity, if there is one."""
        return self.chain if self.chain or self.model is None else self.model.chain

    @property
    def gradient(self) -> FloatArray:
        """Return d gravity_n / d q_j (M, N, N) in N·m/rad, computed on demand."""
        if self.known_gradient is not None:
            return self.known_gradient
        if 'gradient' not in self.memo:
            if self.model is None:
                raise ValueError('a motion without a model has no gradient of its gravity')
            self.memo['gradient'] = gravity_gradient(self.model, self.samples.q)
        return self.memo['gradient']

    def direction(self, joint: int) -> FloatArray:
        """Return the direction of a joint's friction, (M,), from -1 to 1."""
        if joint not in self.directions:
            hold = 0.0 if self.hold is None else float(self.hold[joint])
            ramp = self.ramp is not None and bool(self.ramp[joint])
            self.directions[joint] = direction(
                self.samples, self.samples.q[:, joint], self.samples.qd[:, joint],
                Shape(float(self.sign_width[joint]), hold, ramp))
        return self.directions[joint]

    def with_model(self, model: GravityModel, gravity: FloatArray | None = None) -> Motion:
        """Return the motion with another gravity model, and its torque (M, N) if known."""
        torque = model.predict(self.samples.q) if gravity is None else gravity
        return replace(self, model=model, gravity=torque, known_gradient=None, chain=None)

    def at(self, rows: IntArray) -> Motion:
        """Return the motion at samples number `rows`, ascending, for pointwise effects."""
        directions = {joint: self.direction(joint)[rows]
                      for joint in range(self.samples.n_joints)}
        gradient = None if self.known_gradient is None else self.known_gradient[rows]
        part = replace(self, samples=self.samples.select(rows), qdd=self.qdd[rows],
                       gravity=self.gravity[rows], known_gradient=gradient, directions=directions)
        part.memo.update({key: value[rows] for key, value in self.memo.items()})
        return part


def build_motion(samples: JointSamples, model: GravityModel,
                 options: AccelerationOptions = AccelerationOptions()) -> Motion:
    """
    Return the motion of samples with a gravity model; joints are in the model's order.

    :raises DataError: if there are no samples.
    :raises ModelMismatchError: if a joint of the model is not among the samples.
    """
    samples = samples.joints(model.joints)
    if not len(samples):
        raise DataError('effects cannot be computed: there are no samples')
    gravity = model.predict(samples.q)
    residual, narrowest = samples.tau - gravity, min_widths(samples)
    qdd = accelerations(samples, options)
    shapes = [find_shape(samples, samples.q[:, n], samples.qd[:, n], qdd[:, n], residual[:, n],
                         float(narrowest[n])) for n in range(samples.n_joints)]
    return Motion(samples, qdd, gravity, None, np.array([shape.width for shape in shapes]), model,
                  np.array([shape.hold for shape in shapes]),
                  ramp=np.array([float(shape.ramp) for shape in shapes]))
