"""What a user works with: runs, joints, units, and which samples gravity shows in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math
import shlex

from gravity_comp_ros.api.axes import AxesOptions
from gravity_comp_ros.api.learn import LearnOptions, WITH_AXES
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.estimation.fit import FitOptions
from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport


@dataclass(frozen=True)
class Choice:
    """
    Which runs (by number) and joints, how they are read, and which samples are used.

    `effort_scale` holds N·m per unit of effort, sign included, 1 where not given;
    `differentiate` takes speeds from positions. `urdf` is a robot description whose axes are
    used, `none` for none; None takes what the recordings hold. Gravity is learned from and
    judged on samples slower than `max_speed` in rad/s (None: the usual limit), or all of them.

    :raises OptionError: if a number makes no sense.
    """

    runs: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()
    formulation: str = FitOptions().formulation
    effort_scale: Mapping[str, float] = field(default_factory=dict)
    differentiate: bool = False
    max_speed: float | None = None
    all_samples: bool = False
    urdf: str | None = None

    def __post_init__(self) -> None:
        if self.max_speed is not None and not (math.isfinite(self.max_speed)
                                               and self.max_speed > 0.0):
            raise OptionError(f'the speed limit is {self.max_speed} rad/s; it must be above 0')
        for joint, scale in self.effort_scale.items():
            if not math.isfinite(scale) or scale == 0.0:
                raise OptionError(f'the scale of the effort of {joint} is {scale}; it must be '
                                  f'finite and not 0')

    def reading(self, topic: str | None) -> ReadOptions:
        """Return how recordings are read."""
        scale = {joint: x for joint, x in self.effort_scale.items()
                 if x != 1.0 and (not self.joints or joint in self.joints)}
        return ReadOptions(topic, self.joints or None, scale, self.differentiate)

    def learning(self, ordered: bool) -> LearnOptions:
        """
        Return how gravity is learned.

        :param ordered: whether the user gave the joints in the order of the arm.
        """
        axes = AxesOptions(self.urdf if self.formulation in WITH_AXES else None)
        return LearnOptions(self.formulation, axes, ordered)

    def learning_words(self) -> list[str]:
        """Return the arguments of a command that learns the same."""
        axes = [] if self.urdf is None or self.formulation not in WITH_AXES else [
            '--urdf', self.urdf]
        return ['--formulation', self.formulation, *axes]

    def gate(self) -> GateOptions | None:
        """Return which samples gravity is learned from and judged on; None: all."""
        if self.all_samples:
            return None
        return GateOptions() if self.max_speed is None else GateOptions(self.max_speed)

    def recording(self, samples: JointSamples, reports: Sequence[ReadReport]) -> Recording:
        """
        Return the chosen runs and joints of all that was read.

        :raises DataError: if no run is chosen.
        """
        runs = [samples.run(number) for number in self.runs]
        if not runs:
            raise DataError('no run is chosen')
        return Recording(concatenate(runs).joints(self.joints), self.gate(),
                         tuple(reports[number] for number in self.runs))

    def reading_words(self, topic: str | None, joints: bool = True) -> list[str]:
        """Return the arguments of a command that reads the same."""
        words = [] if topic is None else ['--topic', topic]
        if joints:
            words += ['--joints', ','.join(self.joints)]
        options = self.reading(topic)
        for joint, scale in options.effort_scale.items():
            words += ['--effort-scale', f'{joint}={scale!r}']
        return words + (['--differentiate'] if self.differentiate else [])

    def gate_words(self) -> list[str]:
        """Return the arguments of a command that uses the same samples."""
        if self.all_samples:
            return ['--all-samples']
        return [] if self.max_speed is None else ['--max-speed', repr(self.max_speed)]


def line(*words: str) -> str:
    """Return a command line of these words, quoted where a shell would take them apart."""
    return shlex.join(words)
