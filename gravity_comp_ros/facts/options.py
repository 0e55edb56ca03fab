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
    # rad/s^2. No joint that carries links accelerates faster.
    max_acceleration: float = 100
    # Standard deviations of the deviation from the median of five samples: never noise.
    spike_spread: float = 20
    # Share of the range of a joint's effort by which a spike exceeds the range.
    spike_margin: float = 0.5
    # Share of samples above which outliers, unchanged values or wrong stamps are a property of the
    # signal.
    max_outliers: float = 0.1
    # Share of samples that is no coincidence: at a limit of the effort and next to it, or of
    # another publisher.
    rare: float = 0.01
    # Equal values beyond coincidence: consecutive samples, and those at a limit relative to the
    # usual number per level next to it.
    equal_values: float = 10
    # rad. Motion of a joint that neither noise nor a few counts make.
    min_motion: float = 0.05
    # s. Values that are exactly the same, or efforts of exactly 0, for longer are no hold of a
    # sample by a driver: it is frozen, or the drives are not enabled yet.
    min_time: float = 1.0
    # rad. Travel of a joint that counts as motion, several counts of a coarse encoder, and travel
    # at which sine and cosine of its angle differ from a line.
    min_travel: float = 0.01
    wide_travel: float = 0.3
    # rad. Maximum difference between a jump and a whole turn: motion and noise of one sample.
    near_turn: float = 0.5
    # Ratio of the variances of the step and of the position, under which positions are those of a
    # motion rather than poses in a random order (2); also that of the steps over two messages and
    # over one, under which positions alternate.
    smooth: float = 0.2
    # Share of slow samples below which a recording is fast.
    min_slow: float = 0.2
    # Share of the effort's variance that depends on the pose, if gravity acts on the joint, and of
    # the rest that the direction of motion explains, for a decision on the sign on several joints.
    # Friction of real arms explains 0.2 to 1. Share for a decision on one joint.
    min_share: float = 0.2
    min_single_share: float = 0.5
    # Share of the effort's standard deviation: less gravity may be the shape of friction, and less
    # friction gravity that the first-order fit does not model.
    min_part: float = 0.1
    # Speed, relative to the fastest one, over which friction changes its direction.
    slow_speed: float = 0.05
    # Ratio of squared residuals, from which another explanation is right: a direction or zero of
    # an axis, angles in degrees, effort behind a filter; of real arms without one the last is 0.6
    # at least.
    better: float = 0.5
    # Samples that a fit or a search for exact values needs, at most.
    max_samples: int = 5000
    # s. Time constants of a filter from which the search begins; the last is the longest one.
    lags: tuple[float, ...] = (0.1, 0.5, 2.5)
    # rad. Angles over which friction may build up after a reversal: those of gears, and of belts.
    angles: tuple[float, ...] = (3e-4, 3e-3, 3e-2)
    # Number of joints that move widely, above which one of them at least carries gravity: a
    # vertical axis and the roll of the last link carry none.
    min_wide_joints: float = 3
    # Share of messages from which a defect is an error; rarer ones are dropped. Also the changes
    # from one publisher to the other per message of the rarer one (publishers alternate, whereas
    # the arrays of one change once, as its drives are enabled), and the share of the usual effort
    # that falls to 0; that of a coarse sensor falls less.
    common: float = 0.5
    # Position, velocity or effort in any unit that is no measurement.
    max_magnitude: float = 1e9
    # Number of times that the recorder's clock is set back: the messages of a file whose log times
    # go back more often are not in the order of their arrival.
    max_steps: int = 3
    # s, and median intervals: shortest gap.
    gap: float = 10.0
    gap_steps: float = 100.0
    # s. Between rows of one message; far below any interval of messages.
    same_time: float = 1e-4
    # Share of all joints that belong to arms, and number of joint names that two arms have in
    # common if these have sides, and otherwise.
    min_arms: float = 0.6
    min_side_names: int = 2
    min_names: int = 4
    # rad/s. Mean speed of the fastest joint of a table with intervals of at least `long_interval`,
    # in s; time in another unit has smaller ones.
    min_speed: float = 5e-3
    long_interval: float = 0.5
    # Factor between a measured velocity and the rate of change of the position.
    tolerance: float = 1.25

    def __post_init__(self) -> None:
        check_positive(self, 'facts')


FACTS = FactOptions()
