"""What to read of a recording, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.recordings.units import TORQUE_UNITS
import numpy as np


@dataclass(frozen=True)
class ReadOptions:
    """
    What to read.

    `topic`: the JointState topic; if None, the only one there is, or `/joint_states`.
    `joints`: these, in this order; if None, all of them in the order of the first message.
    `effort_scale`: N·m per unit of effort by joint, sign included; 1 where not given.
    A joint is given by its name, or by its number from 1 in the order of the first message.
    `differentiate`: take speeds from positions although there are velocities.
    `degrees`: positions and velocities are in degrees.
    `effort_unit`: one of `TORQUE_UNITS`; the scale is N·m per unit beside it.
    `rename`: other names for joints, by the name in the recording; all else goes by these.
    `most`: of more messages than this an even part is read, so that memory is bounded; None reads
    all.

    :raises OptionError: if a scale is 0 or not finite, joints or new names repeat, the unit is
        unknown, or no message may be read.
    """

    topic: str | None = None
    joints: tuple[str, ...] | None = None
    effort_scale: Mapping[str, float] = field(default_factory=dict)
    differentiate: bool = False
    degrees: bool = False
    effort_unit: str = 'Nm'
    rename: Mapping[str, str] = field(default_factory=dict)
    most: int | None = None

    def __post_init__(self) -> None:
        if self.most is not None and self.most < 1:
            raise OptionError(f'{self.most} messages to read; it must be 1 or more')
        for joint, scale in self.effort_scale.items():
            if not np.isfinite(scale) or scale == 0:
                raise OptionError(f'effort scale of joint {joint} is {scale}; it must be finite '
                                  f'and not 0')
        if self.effort_unit not in TORQUE_UNITS:
            raise OptionError(f'effort unit {self.effort_unit!r} is not one of '
                              f'{", ".join(TORQUE_UNITS)}')
        if len(set(self.rename.values())) < len(self.rename):
            raise OptionError(f'two joints get the same name: {", ".join(self.rename.values())}')
        if self.joints is not None:
            if not self.joints:
                raise OptionError('no joints chosen')
            if len(set(self.joints)) < len(self.joints):
                raise OptionError(f'joints repeat: {", ".join(self.joints)}')

    def scale(self, joints: Sequence[str]) -> dict[str, float]:
        """Return N·m per unit of effort as recorded, sign included, for each joint."""
        unit = TORQUE_UNITS[self.effort_unit]
        return {joint: unit * float(self.effort_scale.get(joint, 1.0)) for joint in joints}


@dataclass(frozen=True)
class ReadReport:
    """
    How a recording became samples.

    `n_messages` were on `topic`, `n_samples` were kept, `dropped` counts the others by
    reason. `velocity` is 'measured' or 'differentiated'. `rate_hz` is one over the median
    interval; `start_ns` the time of the first sample since the epoch; `sha256` identifies
    the data. `effort_scale` are the N·m per unit by joint that were used, where not 1.
    """

    path: Path
    topic: str
    n_messages: int
    n_samples: int
    dropped: Mapping[str, int]
    velocity: str
    rate_hz: float
    duration_s: float
    start_ns: int
    sha256: str
    effort_scale: Mapping[str, float]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return what identifies and describes the recording, as a model's provenance has it."""
        return {'name': self.path.name, 'sha256': self.sha256, 'topic': self.topic,
                'n_messages': self.n_messages, 'n_samples': self.n_samples,
                'dropped': dict(self.dropped), 'velocity': self.velocity,
                'rate_hz': self.rate_hz, 'duration_s': self.duration_s,
                'effort_scale': dict(self.effort_scale), 'notes': list(self.notes)}


@dataclass(frozen=True)
class Recording:
    """One bag as one run of samples; time 0 is its first sample."""

    samples: JointSamples
    report: ReadReport
