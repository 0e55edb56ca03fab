"""Settings of the workbench: runs, joints, units, formulation and samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
import shlex

from gravity_comp_ros.api.axes import AxesOptions
from gravity_comp_ros.api.learn import LearnOptions, WITH_AXES
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport


@dataclass(frozen=True)
class Choice:
    """
    Chosen runs (by number) and joints, options of reading, and samples.

    The joints are those of `joints`, in this order. `urdf` is the robot description for the joint
    axes, `none` for no description, None for that of the recordings. Gravity is fitted to and
    compared on samples slower than `max_speed` in rad/s (None: the default limit), or all samples.

    :raises OptionError: if a value is invalid.
    """

    runs: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()
    formulation: str = FitOptions().formulation
    reading: ReadOptions = ReadOptions()
    max_speed: float | None = None
    all_samples: bool = False
    urdf: str | None = None

    def __post_init__(self) -> None:
        if self.max_speed is not None and not (math.isfinite(self.max_speed)
                                               and self.max_speed > 0.0):
            raise OptionError(f'the speed limit is {self.max_speed} rad/s; it must be above 0')

    def options(self) -> ReadOptions:
        """Return the options to read the recordings; what is refused is refused by each job."""
        scale = {joint: x for joint, x in self.reading.effort_scale.items()
                 if x != 1.0 and (not self.joints or joint in self.joints)}
        return replace(self.reading, joints=self.joints or None, effort_scale=scale, refuse=False)

    def learning(self, ordered: bool) -> LearnOptions:
        """
        Return the options of the fit.

        :param ordered: whether the joints are given in the order of the arm.
        """
        axes = AxesOptions(self.urdf if self.formulation in WITH_AXES else None)
        return LearnOptions(self.formulation, axes, ordered)

    def fit_options(self) -> list[str]:
        """Return the arguments of a command with the same fit."""
        axes = [] if self.urdf is None or self.formulation not in WITH_AXES else [
            '--urdf', self.urdf]
        return ['--formulation', self.formulation, *axes]

    def gate(self) -> GateOptions | None:
        """Return the gate for the fit and the comparison; None for all samples."""
        if self.all_samples:
            return None
        return GateOptions() if self.max_speed is None else GateOptions(self.max_speed)

    def recording(self, samples: JointSamples, reports: Sequence[ReadReport]) -> Recording:
        """
        Return the chosen runs and joints of all recordings.

        :raises DataError: if no run is chosen.
        """
        runs = [samples.run(number) for number in self.runs]
        if not runs:
            raise DataError('no run is selected')
        return Recording(concatenate(runs).joints(self.joints), self.gate(),
                         tuple(reports[number] for number in self.runs))

    def gate_options(self) -> list[str]:
        """Return the arguments of a command with the same gate."""
        if self.all_samples:
            return ['--all-samples']
        return [] if self.max_speed is None else ['--max-speed', repr(self.max_speed)]


def line(*arguments: str) -> str:
    """Return a command line of these arguments, quoted for the shell."""
    return shlex.join(arguments)
