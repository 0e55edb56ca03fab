"""Thresholds of a diagnosis, and their reasons."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.errors import OptionError


@dataclass(frozen=True)
class DiagnosisOptions:
    """
    Options of a diagnosis.

    - `effects`: the effects to test (None: all).
    - `established`: gain in nats of an established effect; odds of 20,000 to 1.
    - `min_reduction`: smallest relative decrease of the held-out RMSE of the most affected joint
      that is worth adding.
    - `min_remaining`: share of the torque range above which a joint's remaining error is reported,
      and share of the error of a joint by which the part that repeats with its angle must reduce
      it to be a finding.
    - `min_effective`: effective sample size that an established effect needs; intervals over
      fewer independent blocks are too narrow.

    :raises OptionError: if a value is out of range.
    """

    effects: tuple[str, ...] | None = None
    established: float = 10.0
    min_reduction: float = 0.002
    min_remaining: float = 0.01
    min_effective: float = 20.0

    def __post_init__(self) -> None:
        if min(self.established, self.min_reduction, self.min_remaining,
               self.min_effective) < 0.0:
            raise OptionError('diagnosis: thresholds are at least 0')
