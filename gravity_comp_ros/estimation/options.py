"""Constants of estimates, updates and the facts on the efforts, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


@dataclass(frozen=True)
class EstimationOptions:
    """
    Constants of estimates.

    Held-out errors:

    - `min_rows`: smallest number of rows of 0.1 s. With fewer, a fifth of them has too few to
      judge an effect.
    - `max_increase`: largest share by which an added effect may increase a joint's held-out error.

    Another hypothesis about an arm (`ArmFit`):

    - `max_time`: correlation time of white residuals, in rows of some tenths of a second; that of
      a wrong hypothesis is that of the motion.
    - `min_gain`: log evidence in nats, over the autocorrelation time.

    Gains that disagree:

    - `min_ratio`: smaller differences are the effect `torque_gain`; other units and ratings differ
      by more.
    - `min_error`: gain of a joint like a payload of a tenth of the arm. It is named where others
      are refused, and refused in an update, which has no effect for it.
    - `sigmas`: standard deviations by which the logarithm of a gain differs from 0.
    - `max_residual`: share of a joint's effort (without friction) that an arm with these gains
      may leave, and `max_reference` of the joint with the largest effort; more is another effect.
    - `friction`: standard deviation of the logarithm of a joint's friction and inertia between two
      recordings, by temperature and load.
    - `min_coloured`: residual of equal gains beyond its white noise, as a share of the largest
      effort, that gains far from 1 leave at least; a ratio of 1.5 leaves 0.07. With less, they
      are not searched from other starts.
    - `starts`: drawn gains at the start of the search, whose logarithms have the standard
      deviation `spread`.

    A base that tilts:

    - `min_tilt`, rad: a smaller tilt may be a soft floor, with little torque.
    - `linear_tilt`, rad: the effect `base_tilt` is linear in the tilt and describes a smaller one.
    - `tilt_gain`: log evidence in nats, over the autocorrelation time, for each of the four
      numbers of a tilt.
    - `max_tilts`: a base that tilts more often is not searched for.
    - `places`: number of times at which a tilt is tried first.

    Change of a model by new samples:

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

    min_rows: int = 60
    max_increase: float = 0.05
    max_time: float = 10.0
    min_gain: float = 10.0
    min_ratio: float = 1.5
    min_error: float = 1.1
    sigmas: float = 4.0
    max_residual: float = 0.3
    max_reference: float = 0.1
    friction: float = 0.15
    min_coloured: float = 0.02
    starts: int = 3
    spread: float = 1.2
    min_tilt: float = 0.05
    linear_tilt: float = 0.1
    tilt_gain: float = 3.0
    max_tilts: int = 3
    places: int = 12
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
        check_positive(self, 'estimation')


OPTIONS = EstimationOptions()
