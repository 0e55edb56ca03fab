"""Options of the check of a description, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


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
