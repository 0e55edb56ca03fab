"""Constants of the node that are no parameters, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass
import math

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.option_checks import check_positive

REVOLUTION = 2.0 * math.pi


@dataclass(frozen=True)
class NodeOptions:
    """
    Times, windows and sizes of the node; those of decisions are `CheckOptions`.

    Input:

    - `max_continuous`, rad: largest position of a continuous joint; encoder faults exceed it.
    - `stamps`: consecutive messages with earlier but rising stamps after which the clock counts
      as set back.
    - `slope_time`, s: velocity is checked against the mean slope of position over it, at most
      over `max_slope_time`. It contradicts a slope that exceeds `slope_factor` times it, for
      acceleration, plus `slope_margin`, rad/s, for noise.
    - `max_late`: share of messages replaced by newer ones above which there is a warning.

    Samples of an epoch:

    - `max_delay`, s: largest delay of a driver from command to reported effort, and `delay_steps`:
      number of delays up to it that are tried.
    - `period`, s: of samples, that of the gate; `block`: consecutive samples, which are
      correlated, that are held out together, one block in `held_out_every`, and that come between
      two tests for a payload.
    - `growth`: of the number of samples, after which the next fit is due.
    - `capacity`: maximum number of samples, five minutes at 5 Hz; then one of each cell of poses
      and velocities stays, the newest. `cell_time`, s: weight of velocity in a cell.
    - `min_known`: share of the samples whose acceleration must be resolved for the use of any.
    - `min_motion`, rad: a sample closer to the last one is redundant.
    - `min_range`, rad: motion that each joint needs before the last fit.

    Watch of the model in use:

    - `window`: slow samples of the shortest test for a payload, six seconds at the default rate,
      in `parts` parts: a contact shorter than two seconds is not present in each of them. A new
      model is judged on half of them. A longer window is thinned to `max_window` samples.
    - `max_acceleration`, rad/s^2: above it inertia is not negligible.
    - `max_required`: samples at most that confirm a model.

    Torque:

    - `period_messages`: time constant of the mean period; `max_periods`: largest time step of a
      message in this period, so that the first one after a stall makes no large step.
    - `watch_period`, s: of calls of the watchdog, and of polling the fit process.
    - `ramp_share`: largest change of a joint's torque within `ramp_time` by a transition to a
      model, as a share of its limit `max_torque`: a wrong model then moves any arm slowly.
    - `rounding`, N·m: of an offset.
    - `turn_margin`, rad: beyond half a revolution from the trained range up to which a joint keeps
      its revolution: the torque held on the other side is another one, and noise or the swing of
      an arm at that pose must not alternate between both.

    Process:

    - `depth`: of the topics with history, and earlier payloads whose last model is kept.
    - `calls`: depth of a service. With the default the eleventh of simultaneous calls is lost.
    - `last_save`, s: maximum time for pending saves as the node ends.
    - `others_period`, s: of callbacks other than the input while messages arrive. The search of
      rclpy for them takes as long as a message, so that at 1 kHz it delays one message in two
      hundred. They run at once in a `pause`, s, for `others_time`, s, at most.
    - `messages`: taken at once, the depth of the queue: a pause of the process of 0.1 s at 1 kHz.
    - `switch_interval`, s: longest time that the control thread waits for another thread.
    - `niceness`: minimum nice value of the fit process.

    :raises OptionError: if a number is not positive.
    """

    max_continuous: float = 1000.0
    stamps: int = 5
    slope_time: float = 0.1
    max_slope_time: float = 0.5
    slope_factor: float = 1.5
    slope_margin: float = 0.05
    max_late: float = 0.1
    max_delay: float = 0.2
    delay_steps: int = 100
    period: float = 1.0 / (GateOptions().rate_hz or 1.0)
    block: int = 5
    held_out_every: int = 4
    growth: float = 1.25
    capacity: int = 1500
    cell_time: float = 1.0
    min_known: float = 0.9
    min_range: float = 0.2
    window: int = 30
    parts: int = 3
    max_window: int = 75
    min_motion: float = 0.005
    max_acceleration: float = 0.25
    max_required: int = 200
    period_messages: int = 5
    max_periods: float = 2.0
    watch_period: float = 0.02
    ramp_share: float = 0.2
    rounding: float = 1e-9
    turn_margin: float = 0.2
    depth: int = 10
    calls: int = 1000
    last_save: float = 1.0
    others_period: float = 0.2
    pause: float = 0.005
    others_time: float = 0.002
    messages: int = 100
    switch_interval: float = 1e-4
    niceness: int = 10

    def __post_init__(self) -> None:
        check_positive(self, 'node')


NODE = NodeOptions()


@dataclass(frozen=True)
class CheckOptions:
    """
    Limits of the checks, and of the data that they use; ratios have no unit, evidence is in nats.

    - `max_rise`: a model may raise the RMSE of no joint by more than this factor plus its noise.
    - `significant`: standard deviations by which a model of more samples may have a larger error
      on held-out samples: its expected error is smaller, and the figures of two equal ones differ.
      Also those by which a mass or a reach may exceed its limit, and the share of gravity may be
      below it.
    - `min_noise`: smallest noise and error, as a fraction of the largest torque of the samples.
    - `min_span`, rad: range from which, with the samples of a full fit, an effort of which pose
      explains too little (`FactOptions.min_share`) has no gravity.
    - `max_own`, `max_largest`: residual of a first model as a fraction of the joint's own
      variation, and of the largest one; of a change where no chain explains the arm, `max_largest`
      of the change, or `predicted` times the noise.
    - `min_gravity`: smallest fraction of the arm's own gravity in the effort; without a tool of
      5 kg it is 0.58 on an iiwa.
    - `max_residual`: residual after the fit of a body, in units of the noise of earlier epochs.
      Real payloads reached 1.6 after 100 samples, faulty joints 3 and more.
    - `margin`: log evidence by which a fault, with or without a body, may explain the change
      better, and by which a body must do so better than a varying force, a ratio of 20. After 7 s
      a dead wrist of an arm without known axes has 3.1 and more, a real payload 4.0 at most, and
      less with each second. Payloads of 1 to 5 kg had 10 to 200 over a varying force in sixteen.
      A fault is a gain or a factor that differs from 1 by at least `min_gain_change`.
    - `max_echo`: largest ratio of the model's residual to that of the published torque.
    - `min_body`: log evidence of a body over none for a suspicion, odds of 5e8 to 1.
    - `min_over_push`: log evidence of a body over a push. Payloads of 0.5 to 5 kg had 11 to 54 in
      six seconds of motion.
    - `full_fit_margin`, `sparse_margin`: fraction by which a full fit must have a smaller held-out
      error than the change of the old model, and a potential than a chain. On about thirty
      samples a model that was wrong at other poses was better by a tenth.
    - `new_effects`: factor of the noise of earlier epochs where gravity is fitted jointly with
      new effects.
    - `max_outliers`: largest share of outliers; a larger one means that the model or the effort
      is wrong.
    - `min_published`, `min_published_share`: published torque that supports an arm, RMS in N·m,
      and share of the samples with published torque.
    - `min_variation`: smallest variation of the published torque of a joint that is compared, as
      a fraction of the largest.
    - `predicted`, `max_unpredicted`: residual in units of noise up to which a model predicts a
      new sample, and up to which it predicts a window of them; `max_previous`: largest ratio of
      the previous model's residual to it for a rollback.
    - `large`, `min_large`: a test for a payload is due where this share of the samples of each
      part of the window has a joint with a residual of this many times the noise.

    Priors of the hypotheses, as standard deviations:

    - `correlated`: factor of the noise for the autocorrelated model error of slow samples.
    - `body`: body on the last link, relative to half of the payload limits, or without known axes
      to `moment` times the largest residual; the scale is that of the largest evidence.
    - `force`: relative variation of the force of a hand within `force_time`, s.
    - `converged`: change of a gain at which its linearisations end.

    :raises OptionError: if a limit is not positive.
    """

    max_rise: float = 1.2
    significant: float = 2.0
    min_noise: float = 1e-3
    min_span: float = 0.5
    max_own: float = 0.35
    max_largest: float = 0.1
    min_gravity: float = 0.25
    max_residual: float = 2.5
    margin: float = 3.0
    min_gain_change: float = 0.1
    max_echo: float = 0.9
    min_body: float = 20.0
    min_over_push: float = 10.0
    full_fit_margin: float = 0.25
    sparse_margin: float = 0.1
    new_effects: float = 2.0
    max_outliers: float = 0.3
    min_published: float = 0.05
    min_published_share: float = 0.5
    min_variation: float = 0.02
    predicted: float = 4.0
    max_unpredicted: float = 6.0
    max_previous: float = 0.5
    large: float = 3.0
    min_large: float = 0.75
    correlated: float = 2.0
    body: tuple[float, ...] = (0.01, 1.0 / 30.0, 0.1, 1.0 / 3.0, 1.0)
    moment: float = 30.0
    force: float = 0.3
    force_time: float = 2.0
    converged: float = 1e-3

    def __post_init__(self) -> None:
        check_positive(self, 'checks')


CHECKS = CheckOptions()
