"""Thresholds of the facts, each with its unit and reason."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive
import numpy as np


@dataclass(frozen=True)
class FactOptions:
    """
    Thresholds of the facts about a recording.

    :raises OptionError: if a threshold is not positive and finite.
    """

    # Samples. With fewer, shares and spreads have no meaning.
    min_samples: float = 100
    # Slow samples. With fewer, the errors of a model or of a calibration are not known.
    min_slow_samples: float = 50
    # rad. Two turns either way: no cable survives more, counters of turns and degrees exceed it.
    max_angle: float = 4 * np.pi
    # N·m. The strongest joint of an arm that carries its own links needs more: 3 for the smallest.
    min_torque: float = 0.1
    # N·m. Axis 2 of an arm of 1 t payload holds less.
    max_torque: float = 2e4
    # N·m. Smaller than any sensor resolves: denormal or unset numbers.
    dead_torque: float = 1e-6
    # Recorded units. Smaller whole numbers may be torques of a coarse sensor.
    min_count: float = 10
    # rad. Deviation of a single sample from its neighbours: several counts of a coarse encoder.
    min_glitch: float = 0.01
    # rad/s^2. No joint that carries links accelerates faster.
    max_acceleration: float = 100
    # Standard deviations of the deviation from the median of five samples: never noise.
    spike_spread: float = 20
    # Share of the range of a joint's effort by which a spike exceeds the range.
    spike_margin: float = 0.5
    # Share of samples above which outliers are a property of the signal.
    max_outliers: float = 0.1
    # Share of samples at a limit of the effort, above which it may be clipped, and below which
    # it is still a limit rather than the usual value.
    min_clipped: float = 0.01
    max_clipped: float = 0.95
    # Times the usual number of samples per level next to the limit.
    clipped_excess: float = 10
    # rad. Motion of a joint while its effort or position stays exactly the same.
    frozen_travel: float = 0.1
    # s and samples. Longer than any plausible hold of a sample by a driver.
    frozen_time: float = 2.0
    frozen_samples: float = 20
    # Share of unchanged consecutive samples, above which a signal is coarse rather than frozen.
    coarse_share: float = 0.2
    # s. Drives are enabled by hand: the effort is 0 before it for longer than a lost message.
    disabled_time: float = 0.5
    # rad. Travel of a joint that counts as motion, and travel at which sine and cosine of its
    # angle differ from a line.
    min_travel: float = 0.01
    wide_travel: float = 0.3
    # Share of the effort's variance that depends on the pose, if gravity acts on the joint.
    min_pose_share: float = 0.3
    # Share of the effort's standard deviation: less of it with friction may be its shape.
    min_gravity: float = 0.1
    # Shares of the residual variance of the pose that the direction of motion explains, for a
    # decision on the sign on several joints and on one. Friction of real arms explains 0.2 to 1.
    min_direction_share: float = 0.2
    min_single_share: float = 0.5
    # Share of the effort's range: a smaller torque of the direction may be gravity that the
    # first-order fit does not model.
    min_direction_torque: float = 0.02
    # Ratio of squared residuals, from which another direction or zero of an axis is right.
    better_axes: float = 0.5
    # Ratio of squared residuals, from which the effort is behind a filter: of real arms without
    # one it is 0.6 at least.
    better_lag: float = 0.5
    # Ratio of squared residuals, from which angles are degrees; travel in the recorded unit, from
    # which sines and cosines of true angles differ from lines.
    better_unit: float = 0.5
    degrees_travel: float = 3.0
    # Share of the variance of the effort without friction that a fit must explain to count.
    min_explained: float = 0.75
    # Number of joints that move widely, above which one of them at least carries gravity: a
    # vertical axis and the roll of the last link carry none.
    min_wide_joints: float = 3

    def __post_init__(self) -> None:
        check_positive(self, 'facts')
