"""Options of calibrations, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


@dataclass(frozen=True)
class CalibrationOptions:
    """
    Options of the calibrations of efforts and servos.

    - `significance`: least size of an estimate 1 / k in standard deviations: k is then certain to
      a fifth, and its interval is symmetric.
    - `distance`, m: prior standard deviation of each coordinate of an unknown centre of mass.
    - `arm_factor`: the weight of the arm is that of the description within this factor.
      Descriptions have rough masses; a wrong mass of the known weight gives others, and exchanged
      recordings negative ones.
    - `same_offset`: whether the recordings without and with the weight have the same offset.

    :raises OptionError: if a number is not positive.
    """

    significance: float = 10.0
    distance: float = 0.2
    arm_factor: float = 10.0
    same_offset: bool = False

    def __post_init__(self) -> None:
        check_positive(self, 'calibration', 'significance', 'distance', 'arm_factor')
