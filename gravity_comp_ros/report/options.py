"""Limits of the report, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


@dataclass(frozen=True)
class ReportOptions:
    """
    Limits of what the report draws and names.

    - `worse`: ratio of an error to the training error beyond statistical uncertainty;
      `larger`: ratio to the median error of the other joints, or of a useless model to its
      training error, that is reported. `max_regions`: of large error, by joint.
    - `max_rows`: samples that are drawn, approximately; a page of them is still quick.
    - `break_steps` and `break_seconds`, s: minimum gap that breaks a line, in median steps too.
    - `min_range`, rad: of a joint, so that one at rest has a cell in the pairs.
    - `max_segment`: samples of one segment of a spectrum over time.
    - `max_order`, cycles per revolution, `order_step`, cycles over the visited range, and
      `max_points`: of a spectrum over the angle; `min_travel`, rad: for one.
    - `max_features`: gravity terms that are fitted again for an added-variable plot; with more
      the residual of the model is used. `max_plots` of them, `max_coefficients` of a finding.
    - `shown_terms`, `max_terms`, `max_stems`: of the model's terms in the equation, in the table
      and in the plot.

    :raises OptionError: if a number is not positive.
    """

    worse: float = 2.0
    larger: float = 3.0
    max_regions: int = 2
    max_rows: int = 12_000
    break_steps: float = 20.0
    break_seconds: float = 2.0
    min_range: float = 1e-3
    max_segment: int = 4096
    max_order: float = 80.0
    order_step: float = 0.5
    max_points: int = 400
    min_travel: float = 0.05
    max_features: int = 500
    max_plots: int = 9
    max_coefficients: int = 4
    shown_terms: int = 8
    max_terms: int = 300
    max_stems: int = 1000

    def __post_init__(self) -> None:
        check_positive(self, 'report')


REPORT = ReportOptions()
