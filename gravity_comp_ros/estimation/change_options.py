"""Constants of an update, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


@dataclass(frozen=True)
class ChangeOptions:
    """
    Constants of the change of a model by new samples.

    - `min_samples`: of an update.
    - `old_noise`: effective sample size of the old model's noise when it is averaged with that of
      the new samples.

    Payload:

    - `mass`, kg, and `distance`, m: prior standard deviations of a payload and of each coordinate
      of its centre.
    - `significant`: size of a mass, in standard deviations, from which its centre is reported, and
      of a moment from which a link has one.
    - `min_path`: torque of a payload in noise levels (RMS, worst joint) from which its direction
      is kept for later payloads.
    - `max_misfit`: of known axes to the old model, as a share of its uncertainty (RMS).

    A change with more coefficients:

    - `free`: gain in chi^2 of a free change of moments over a payload. Of 102 updates with a
      payload in MuJoCo three exceeded it: no model of friction is exact.

    Axes that the old model does not identify:

    - `unidentified`, rad: standard deviation of an axis from which each direction is tried, on
      `axes` joints at most: each one multiplies the trials.
    - `uncertain`, rad: standard deviation of an outer axis that may be at a wrong minimum.
    - `reset`: log evidence in nats that such an axis must gain over the old one, about the
      logarithm of the number of directions.
    - `trials`, `resets`: most probable trials that are solved fully, with old and reset axes.
    - `probable`: share of the largest evidence from which a trial adds to the uncertainty.
    - `max_loss`: chi^2 that the average over supports may lose against the best support, and a
      step of the search against the one before.

    Search:

    - `rounds`: linearisations, and halvings of a step; `max_rotation`, rad: of an axis in a
      linearisation; `converged`: change of the torque in noise levels at which they end.
    - `reversal`: factor by which the speed or distance of a reversal of friction changes with the
      payload.
    - `noise`: relative change of the noise from which the change is solved again.

    :raises OptionError: if a value is not positive.
    """

    min_samples: int = 10
    old_noise: float = 50.0
    mass: float = 30.0
    distance: float = 0.5
    significant: float = 4.0
    min_path: float = 10.0
    max_misfit: float = 0.5
    free: float = 60.0
    unidentified: float = 0.3
    axes: int = 2
    uncertain: float = 0.04
    reset: float = 4.0
    trials: int = 5
    resets: int = 8
    probable: float = 0.01
    max_loss: float = 10.0
    rounds: int = 8
    max_rotation: float = 0.5
    converged: float = 0.05
    reversal: float = 1.8
    noise: float = 0.15

    def __post_init__(self) -> None:
        check_positive(self, 'change of a model')


CHANGE = ChangeOptions()
