"""Times, windows and sizes of the node that are no parameters, with their units and reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive


@dataclass(frozen=True)
class NodeOptions:
    """
    Constants of the node; those of decisions are `checks.CheckOptions`.

    Input:

    - `max_continuous`, rad: largest position of a continuous joint; encoder faults exceed it.
    - `stamps`: consecutive messages with earlier but rising stamps after which the clock counts
      as set back.
    - `slope_time`, s: velocity is checked against the mean slope of position over it, at most
      over `max_slope_time`. It contradicts a slope that exceeds `slope_factor` times it, for
      acceleration, plus `slope_margin`, rad/s, for noise.
    - `max_late`: share of messages replaced by newer ones above which there is a warning.

    Samples of an epoch:

    - `delays`, s: possible delays of a driver from command to reported effort; `delay_steps` is
      the number of interpolated ones from each to the next.
    - `held_out_every`: one block of samples in this many is held out from fits.
    - `growth`: of the number of samples, after which the next fit is due.
    - `capacity`: maximum number of samples, five minutes at 5 Hz; then one of each cell of poses
      and velocities stays, the newest.
    - `min_range`, rad: motion that each joint needs before the last fit.

    Watch of the model in use:

    - `window`: slow samples of the shortest test for a payload, six seconds at the default rate,
      in `parts` parts: a contact shorter than two seconds is not present in each of them. A new
      model is judged on half of them. A light payload with friction needs longer windows:
      `lengths` are relative to the shortest one that lasts long enough.
    - `period`, s, and `min_motion`, rad: closer samples, and those at rest, are redundant.
    - `max_acceleration`, rad/s^2: above it inertia is not negligible.
    - `max_required`: samples at most that confirm a model.
    - `new_samples`: between two tests.

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
    delays: tuple[float, ...] = (0.004, 0.01, 0.02, 0.05, 0.1, 0.2)
    delay_steps: int = 5
    held_out_every: int = 4
    growth: float = 1.25
    capacity: int = 1500
    min_range: float = 0.2
    window: int = 30
    parts: int = 3
    lengths: tuple[float, ...] = (2.5, 5.0 / 3.0, 1.0)
    period: float = 0.2
    min_motion: float = 0.005
    max_acceleration: float = 0.25
    max_required: int = 200
    new_samples: int = 5
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
