"""All constants of the engine, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


@dataclass(frozen=True)
class EngineOptions:
    """
    Constants of the regression.

    Rows:

    - `row_seconds`, s: rows are means over this time. Linear models survive means exactly, so
      that time and memory do not grow with the rate.
    - `max_rows`: with more, the means are over a longer time.
    - `row_samples`: samples of a row at which the columns of effects are computed; at more a
      recording is averaged first. Friction that reverses in a row changes its mean by 1 / (2 x
      `row_samples`) of that friction at most. `max_samples`: of all rows; a row of a longer
      recording has fewer.
    - `jump_angle`, rad: a sample this far from the one before is another pose and no motion
      between both; it begins a row. Motion of 1 rad/s has it at 3 Hz.
    - `rest_angle`, rad, and `rest_seconds`, s: an arm that moves less is at rest, and has one row
      for this time.
    - `cell_angle`, rad: range of a joint within which gravity and dynamics are those at the mean
      state; the error is 4e-5 of the torque.
    - `block_seconds`, s: time over which the scores of a term are summed for their scatter; ten
      times the correlation time of the residual of a drive.

    Noise:

    - `discrepancy`: model error as a share of a joint's torque scale. No law of friction is exact.
    - `law_error`: error of the law of a term as a share of its torque (RMS). It widens the
      published intervals of its coefficients, and a further term that holds the same joint at
      rest must explain more.
    - `floor`: minimum noise as a share of the torque scale, against exact simulated data.
    - `min_scale`: minimum torque scale of a joint as a share of the largest; a joint with a
      vertical axis has none of its own.

    Selection, in nats of log evidence:

    - `min_gain`: gain at which a term is in the model; odds of 20 to 1.
    - `margin`: models within this of the chosen one are ambiguous with it.
    - `near`: models within this of the chosen one are compared with their settings refined,
      which may raise the evidence by as much.
    - `significant`: gain of an exchange or a removal that counts as an improvement, against
      rounding.
    - `min_identified`: share of a coefficient's torque (RMS) that all other columns must leave;
      below it the coefficient is not identified and is not published. What the law of the term
      misses of the real torque is multiplied by the inverse.
    - `min_separate`: the same share of a term's best coefficient, below which a static term is
      predicted with gravity: both alone would be wrong by many times their sum.

    Search:

    - `max_rounds`: rounds of additions, exchanges and removals of one selection.
    - `passes`: linearisations with a selection; `steps`: Gauss-Newton steps after each.
    - `converged`: decrease of the objective, in units of its mean over rows and joints, at which
      Gauss-Newton ends; 2 is one nat where all joints have white residuals.
    - `coloured`: ratio of a joint's residual to its white noise above which pairs of terms and
      other starts are tried; below, nothing is missing that they could explain.
    - `starts`: alternatives from which the terms of a joint are selected again.
    - `halvings`: halvings of the step in which a nonlinear setting is refined.

    :raises OptionError: if a value is not positive.
    """

    row_seconds: float = 0.1
    max_rows: int = 2000
    row_samples: int = 10
    max_samples: int = 10000
    jump_angle: float = 0.3
    rest_angle: float = 5e-4
    rest_seconds: float = 10.0
    cell_angle: float = 0.03
    block_seconds: float = 2.0
    discrepancy: float = 1e-4
    law_error: float = 0.01
    floor: float = 1e-5
    min_scale: float = 0.1
    min_gain: float = 3.0
    margin: float = 3.0
    near: float = 30.0
    significant: float = 1.0
    min_identified: float = 0.02
    min_separate: float = 0.05
    max_rounds: int = 20
    passes: int = 3
    steps: int = 10
    converged: float = 2.0
    coloured: float = 1.3
    starts: int = 5
    halvings: int = 8

    def __post_init__(self) -> None:
        check_positive(self, 'engine')
