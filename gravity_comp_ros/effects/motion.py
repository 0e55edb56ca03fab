"""
From samples and a gravity model to what effects are computed from.

Acceleration is the slope of a cubic fitted to the speed over a short window, on either side of
each sample alike and within one run, so that nothing is shifted in time. The predicted torque
comes from the model in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.differentiation import differentiate, DifferentiationOptions
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.motion_direction import direction, find_shape, least_widths, Shape
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
import numpy as np


@dataclass(frozen=True)
class Motion:
    """
    What effect columns are computed from.

    `samples` are the measured q, qd, tau of all runs; `qdd` (M, N) in rad/s^2 is estimated from
    them; `gravity` (M, N) in N·m is the torque that the gravity model predicts; `slopes` its
    `gradient` where that is known without the model; `sign_width` (N,) in rad/s is the speed
    over which a joint's friction turns its sign, as far as the data tells.
    `model` is the gravity model itself, for effects that are made of its terms. `hold` (N,) in
    rad is the way over which the direction of a joint turns whose friction holds on at rest, 0
    (as for all, if not given) for a joint whose friction lets go.
    """

    samples: JointSamples
    qdd: FloatArray
    gravity: FloatArray
    slopes: FloatArray | None
    sign_width: FloatArray
    model: GravityModel | None = None
    hold: FloatArray | None = None
    # The serial arm that explains gravity where the model is none.
    chain: Chain | None = None
    # Directions by joint, which no gravity model changes.
    directions: dict[int, FloatArray] = field(default_factory=dict, repr=False, compare=False)
    # What is the same for all settings of an effect, kept while the motion lives.
    memo: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False,
                                        compare=False)

    @property
    def serial_arm(self) -> Chain | None:
        """Return the serial arm that explains gravity, if one was fitted."""
        return self.chain if self.chain or self.model is None else self.model.chain

    @property
    def gradient(self) -> FloatArray:
        """
        Return d gravity_n / d q_j (M, N, N) in N·m/rad, the model's stiffness.

        It is computed for the effects that ask for it: few do, and it costs more than the rest.
        """
        if self.slopes is not None:
            return self.slopes
        if 'gradient' not in self.memo:
            if self.model is None:
                raise ValueError('a motion without a model has no gradient of its gravity')
            self.memo['gradient'] = gravity_gradient(self.model, self.samples.q)
        return self.memo['gradient']

    def direction(self, joint: int) -> FloatArray:
        """Return which way a joint moves as its friction sees it, (M,), -1 to 1."""
        if joint not in self.directions:
            hold = 0.0 if self.hold is None else float(self.hold[joint])
            self.directions[joint] = direction(
                self.samples, self.samples.q[:, joint], self.samples.qd[:, joint],
                Shape(float(self.sign_width[joint]), hold))
        return self.directions[joint]

    def beside(self, model: GravityModel, gravity: FloatArray | None = None) -> Motion:
        """Return the motion with another gravity model, and its torque (M, N) if that is known."""
        known = model.predict(self.samples.q) if gravity is None else gravity
        return replace(self, model=model, gravity=known, slopes=None, chain=None)

    def at(self, rows: IntArray) -> Motion:
        """Return the motion at some samples, (K,) rising numbers, for pointwise effects."""
        for joint in range(self.samples.n_joints):
            self.direction(joint)
        slopes = None if self.slopes is None else self.slopes[rows]
        part = replace(self, samples=self.samples.select(rows), qdd=self.qdd[rows],
                       gravity=self.gravity[rows], slopes=slopes, directions={
                           joint: way[rows] for joint, way in self.directions.items()})
        part.memo.update({key: value[rows] for key, value in self.memo.items()})
        return part


@dataclass(frozen=True)
class MotionOptions:
    """
    How acceleration is found: cubic fits to the speed over `window` s.

    0.3 s passes what an arm in careful motion does (up to about 2 Hz) and keeps a speed noise
    of 1 mrad/s at 50 Hz to about 0.006 rad/s^2.

    :raises OptionError: if the window is not positive.
    """

    window: float = 0.3

    def __post_init__(self) -> None:
        if not np.isfinite(self.window) or self.window <= 0:
            raise OptionError(f'acceleration window is {self.window} s; it must be positive')


def build_motion(samples: JointSamples, model: GravityModel,
                 options: MotionOptions = MotionOptions()) -> Motion:
    """
    Return what effect columns are computed from; joints are put in the model's order.

    :raises DataError: if there are no samples.
    :raises ModelMismatchError: if a joint of the model is not among the samples'.
    """
    samples = samples.joints(model.joints)
    if not len(samples):
        raise DataError('no samples to look for effects in')
    gravity = model.predict(samples.q)
    residual, least = samples.tau - gravity, least_widths(samples)
    qdd = accelerations(samples, options)
    shapes = [find_shape(samples, samples.q[:, n], samples.qd[:, n], qdd[:, n], residual[:, n],
                         float(least[n])) for n in range(samples.n_joints)]
    return Motion(samples, qdd, gravity, None, np.array([shape.width for shape in shapes]), model,
                  np.array([shape.hold for shape in shapes]))


def accelerations(samples: JointSamples, options: MotionOptions = MotionOptions()) -> FloatArray:
    """Return qdd (M, N) in rad/s^2, each run for itself; 0 where a sample is alone in time."""
    qdd = np.zeros_like(samples.qd)
    if not samples.qd.any():
        return qdd
    how = DifferentiationOptions(window=options.window)
    for run in run_slices(samples):
        qdd[run] = differentiate(samples.t[run], samples.qd[run], how)
    return np.nan_to_num(qdd, nan=0.0)
