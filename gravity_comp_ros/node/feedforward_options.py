"""Limits and times of the published torque."""

from __future__ import annotations

from dataclasses import dataclass
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
import numpy as np


@dataclass(frozen=True)
class FeedForwardOptions:
    """
    Limits and times of the feed-forward.

    `max_torque` in N·m and `max_torque_rate` in N·m/s have none, one or N values. Times are in s.
    The parameter table describes each field.

    :raises OptionError: if a number is negative or not finite, a policy is unknown, or the
        margin is 0 with `fade`.
    """

    ramp_time: float = 1.0
    max_torque: tuple[float, ...] = ()
    max_torque_rate: tuple[float, ...] = (500.0,)
    extrapolation: str = 'hold'
    extrapolation_margin: float = 1.0
    stale_after: float = 0.3
    stale_action: str = 'fade'
    hold_time: float = 0.5
    fade_time: float = 2.0

    def __post_init__(self) -> None:
        for name in ('ramp_time', 'extrapolation_margin', 'stale_after', 'hold_time',
                     'fade_time'):
            if not 0 <= getattr(self, name) < math.inf:
                raise OptionError(f'feed-forward: {name} is {getattr(self, name)}; it must be '
                                  'finite and not negative')
        if self.extrapolation not in ('hold', 'fade', 'trust'):
            raise OptionError(f'feed-forward: extrapolation is {self.extrapolation!r}; it must '
                              'be hold, fade or trust')
        if self.extrapolation == 'fade' and self.extrapolation_margin == 0.0:
            raise OptionError('feed-forward: extrapolation_margin is 0; with extrapolation fade, '
                              'which falls over this distance, it must be positive')
        if self.stale_action not in ('fade', 'hold'):
            raise OptionError(f'feed-forward: stale_action is {self.stale_action!r}; it must '
                              'be fade or hold')


def per_joint(values: tuple[float, ...], n_joints: int) -> FloatArray | None:
    """Return a limit for each joint (N,), None for none."""
    if not values:
        return None
    if len(values) not in (1, n_joints):
        raise OptionError(f'feed-forward: {len(values)} limits for {n_joints} joints; give one '
                          'for all or one per joint')
    return np.broadcast_to(np.asarray(values, dtype=np.float64), (n_joints,)).copy()
