"""Options, report and result of reading a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.facts.fact import check_kinds, Fact
from gravity_comp_ros.recordings.units import (
    check_effort_unit, EFFORT_UNITS, radians_per_unit, SHARE_UNITS, TORQUE_UNITS)
import numpy as np

# Fields of `ReadOptions` with a command-line option of the same name, in the order in which a
# printed command lists them.
OPTIONS = ('topic', 'joints', 'effort_scale', 'effort_unit', 'rated_torque', 'rename',
           'position_unit', 'accept', 'reverse', 'zero', 'differentiate')


# Fields in which a joint may be given by its number.
BY_JOINT = ('effort_scale', 'rated_torque', 'reverse', 'zero', 'position_unit')
# Units of effort in a bag; a current is scaled by its torque constant (`effort_scale`).
BAG_UNITS = (*TORQUE_UNITS, *SHARE_UNITS)


@dataclass(frozen=True)
class ReadOptions:
    """
    Options of reading.

    - `topic`: JointState topic; None for the only one with messages, or `/joint_states`.
    - `joints`: names in the desired order; None for all joints in order of appearance.
    - `effort_scale`: factor on the effort by joint, sign included; default 1.
    - `differentiate`: compute velocities from positions even if velocities are recorded.
    - `position_unit`: unit of positions and velocities, see `units.radians_per_unit`; for single
      joints by name, then rad for the others.
    - `effort_unit`: unit of the scaled effort, one of `BAG_UNITS`.
    - `rated_torque`: N·m of each joint at 100 %, for efforts in per cent or per mille of it.
    - `rename`: new names of joints, by recorded name; the other options use the new names.
    - `accept`: kinds of facts (`facts.fact.Kind`) that are neither corrected nor refused.
    - `refuse`: whether a recording is refused for its facts; they are listed in the report.
    - `reverse`: joints whose position, velocity and effort have the opposite sign.
    - `zero`: position at which the joint is at 0, by joint, rad; subtracted before `reverse`.
    - `max_messages`: maximum number of messages; a longer recording is subsampled evenly.

    Joints are named, or numbered from 1 in order of appearance in the first recording.

    :raises OptionError: if a scale is 0 or not finite, joints or new names repeat, a unit
        or kind of fact is unknown, or `max_messages` is less than 1.
    """

    topic: str | None = None
    joints: tuple[str, ...] | None = None
    effort_scale: Mapping[str, float] = field(default_factory=dict)
    differentiate: bool = False
    position_unit: str | Mapping[str, str] = 'rad'
    effort_unit: str = 'Nm'
    rename: Mapping[str, str] = field(default_factory=dict)
    max_messages: int | None = None
    accept: tuple[str, ...] = ()
    reverse: tuple[str, ...] = ()
    zero: Mapping[str, float] = field(default_factory=dict)
    refuse: bool = True
    rated_torque: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.max_messages is not None and self.max_messages < 1:
            raise OptionError(f'{self.max_messages} messages to read; it must be 1 or more')
        unit = self.position_unit
        for one in [unit] if isinstance(unit, str) else unit.values():
            radians_per_unit(one)
        check_kinds(self.accept)
        for what, values in (('effort scale', self.effort_scale),
                             ('rated torque', self.rated_torque)):
            for joint, value in values.items():
                if not np.isfinite(value) or value == 0:
                    raise OptionError(f'{what} of joint {joint} is {value}; it must be finite '
                                      f'and not 0')
        check_effort_unit(self.effort_unit, BAG_UNITS, bool(self.rated_torque))
        if len(set(self.rename.values())) < len(self.rename):
            raise OptionError(f'two joints get the same name: {", ".join(self.rename.values())}')
        if self.joints is not None:
            if not self.joints:
                raise OptionError('no joints chosen')
            if len(set(self.joints)) < len(self.joints):
                raise OptionError(f'joints repeat: {", ".join(self.joints)}')

    def scale(self, joints: Sequence[str]) -> dict[str, float]:
        """
        Return N·m per recorded unit of effort, for each joint; `reverse` is not included.

        :raises OptionError: if the rated torque of a joint is missing.
        """
        unit, rated = EFFORT_UNITS[self.effort_unit], self.rated_torque
        unrated = [joint for joint in joints if rated and joint not in rated]
        if unrated:
            raise OptionError(f'the rated torque of {", ".join(unrated)} is missing')
        return {joint: unit * rated.get(joint, 1.0) * float(self.effort_scale.get(joint, 1.0))
                for joint in joints}

    def to_model(self, joints: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return sign, rad per unit and zero in rad of the positions of each joint, (N,) each."""
        unit = self.position_unit
        return (np.array([-1.0 if name in self.reverse else 1.0 for name in joints]),
                np.array([radians_per_unit(unit if isinstance(unit, str) else unit.get(
                    name, 'rad')) for name in joints]),
                np.array([self.zero.get(name, 0.0) for name in joints]))

    def words(self, joints: bool = True) -> list[str]:
        """
        Return the arguments of a command that reads with these options.

        :param joints: whether to include --joints.
        """
        return option_words({name: value for name in OPTIONS
                             if (value := getattr(self, name)) not in ('Nm', 'rad')
                             and (joints or name != 'joints')})


def option_words(values: Mapping[str, object]) -> list[str]:
    """Return the options of a command line with these values, by name; empty values have none."""
    words = []
    for name, value in values.items():
        if value:
            words.append('--' + name.replace('_', '-'))
            words += [] if value is True else [_text(value)]
    return words


def _text(value: object) -> str:
    if isinstance(value, Mapping):
        return ','.join(f'{key}={_exact(part)}' for key, part in value.items())
    return ','.join(value) if isinstance(value, tuple) else _exact(value)


def _exact(value: object) -> str:
    """Return a number in the shortest form that is read as the same number."""
    short = f'{value:g}' if isinstance(value, float) else str(value)
    return repr(value) if isinstance(value, float) and float(short) != value else short


@dataclass(frozen=True)
class ReadReport:
    """
    Report on the reading of a recording.

    - `n_messages`, `n_samples`: messages on `topic`, and samples obtained from them.
    - `dropped`: number of dropped messages by reason.
    - `velocity`: 'measured' or 'differentiated'.
    - `rate_hz`: inverse of the median interval.
    - `start_ns`: time of the first sample, ns since the epoch.
    - `sha256`: digest of the data files.
    - `effort_scale`: N·m per unit of effort by joint, where not 1.
    - `file_notes`: sentences about the file.
    - `facts`: facts about the signals, and what was done about them.
    - `options`: those of reading, with joints by name.
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
    file_notes: tuple[str, ...] = ()
    facts: tuple[Fact, ...] = ()
    options: ReadOptions = ReadOptions()

    @property
    def notes(self) -> tuple[str, ...]:
        """Return sentences about the file and the facts."""
        return (*self.file_notes, *(fact.sentence for fact in self.facts))

    def to_json(self) -> dict[str, Any]:
        """Return the recording's entry in a model's provenance."""
        return {'name': self.path.name, 'sha256': self.sha256, 'topic': self.topic,
                'n_messages': self.n_messages, 'n_samples': self.n_samples,
                'dropped': dict(self.dropped), 'velocity': self.velocity,
                'rate_hz': self.rate_hz, 'duration_s': self.duration_s,
                'effort_scale': dict(self.effort_scale), 'notes': list(self.notes),
                'facts': [fact.to_json() for fact in self.facts]}


@dataclass(frozen=True)
class Recording:
    """Samples of one bag as one run, with time 0 at the first sample, and the report."""

    samples: JointSamples
    report: ReadReport
