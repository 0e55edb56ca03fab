"""Limits of the defects of a recording, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


@dataclass(frozen=True)
class DefectOptions:
    """
    Limits of defects.

    - `common`: share of messages from which a defect is an error; rarer ones are dropped.
    - `max_magnitude`: of a position, velocity or effort in any unit.
    - `max_steps`: of the recorder's clock that was set back; the messages of a file whose log
      times go back more often are not in the order of their arrival.
    - `gap`, s, and `gap_steps`, median intervals: minimum length of a gap.
    - `same_time`, s: between rows of one message; far below any interval of messages.

    Several publishers:

    - `common`: also of the changes from one publisher to the other per message of the rarer one
      (publishers alternate, whereas the arrays of one change once, as its drives are enabled), and
      of the usual effort that falls to 0; that of a coarse sensor falls less.
    - `max_return`: ratio of the step over two messages to that over one, of positions that
      alternate.
    - `min_arms`: share of all joints that belong to arms; two arms share `min_side_names` of their
      joint names if these have sides, else `min_names`.

    Units of a table:

    - `min_speed`, rad/s: mean speed of the fastest joint; time in another unit has smaller ones,
      which are compared with `typical_speed`, rad/s. `min_sparse_speed` that of a table with
      intervals of at least `long_interval`, s, which are long for this unit, too.
    - `tolerance`: factor between a measured velocity and the rate of change of the position.

    :raises OptionError: if a number is not positive.
    """

    common: float = 0.5
    max_magnitude: float = 1e9
    max_steps: int = 3
    gap: float = 10.0
    gap_steps: float = 100.0
    same_time: float = 1e-4
    max_return: float = 0.2
    min_arms: float = 0.6
    min_side_names: int = 2
    min_names: int = 4
    min_speed: float = 5e-4
    min_sparse_speed: float = 5e-3
    long_interval: float = 0.5
    typical_speed: float = 0.3
    tolerance: float = 1.25

    def __post_init__(self) -> None:
        check_positive(self, 'defects')


DEFECTS = DefectOptions()
