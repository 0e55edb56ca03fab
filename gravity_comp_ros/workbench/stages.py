"""Settings of the workbench, and stages of the model with the commands that reproduce them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
import shlex

from gravity_comp_ros.api.axes import AxesOptions
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import Learned, LearnOptions, WITH_AXES
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
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
        return replace(self.reading, joints=self.joints or None, refuse=False)

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


MODEL_FILE = 'arm.json'
# Maximum number of added effects in the name of a stage.
_MAX_NAMED = 2


@dataclass(frozen=True)
class Stage:
    """
    One state of the model.

    A stage is a fit, or a model read from the file `given`, or the stage before it with added
    `effects`. `choice` has the settings of that step. `warnings` are about the model.
    `diagnosis` was made with the settings `diagnosed_with`.
    """

    name: str
    model: GravityModel
    choice: Choice = Choice()
    effects: tuple[str, ...] = ()
    given: Path | None = None
    diagnosis: Diagnosis | None = None
    diagnosed_with: Choice | None = None
    warnings: tuple[str, ...] = ()

    @classmethod
    def of_file(cls, path: Path) -> Stage:
        """
        Return the model of a file.

        :raises ModelFileError: if it cannot be read.
        """
        return cls(path.name, load_model(path), given=path)


@dataclass(eq=False)
class State:
    """
    What is saved of a session. A new one has the arguments of the command alone.

    `given` are model files named on the command line. `joints` are all that can be chosen.
    `stages` are in the order of their creation, and `at` is the number of the current one.
    `to_learn` tells whether a fit was requested. `hashes` are the SHA-256 of the recordings by
    path, when they were read.
    """

    paths: tuple[Path, ...]
    choice: Choice = Choice()
    given: tuple[Stage, ...] = ()
    urdf: Path | None = None
    joints: tuple[str, ...] = ()
    stages: tuple[Stage, ...] = ()
    at: int | None = None
    to_learn: bool = True
    hashes: Mapping[str, str] = field(default_factory=dict)


def command_lines(stages: Sequence[Stage], number: int, bags: tuple[Path, ...]) -> list[str]:
    """
    Return command lines that reproduce the model exactly.

    :param bags: all recordings; the choice of each stage selects among them.
    """
    # From the last fit or file up to this stage.
    start = max(k for k in range(number + 1) if not stages[k].effects)
    return [_command(stage, bags) for stage in stages[start:number + 1]]


def reports(choice: Choice, bags: tuple[Path, ...]) -> list[str]:
    """Return command lines for the comparison and the diagnosis of the page."""
    model = ('--model', MODEL_FILE)
    return [_line('compare', choice, bags, *model, *choice.gate_options()),
            _line('diagnose', choice, bags, *model, '--html', 'report.html')]


def add_command(effects: tuple[str, ...], choice: Choice, bags: tuple[Path, ...],
                model: Path | None = None) -> str:
    """
    Return the command line that adds effects.

    :param model: the model file; by default that of a saved model.
    """
    return _line(f'add {shlex.quote(",".join(effects))}', choice, bags, '--model',
                 MODEL_FILE if model is None else str(model.resolve()), *choice.gate_options())


def added_name(effects: tuple[str, ...]) -> str:
    """Return the name of a stage with added effects."""
    if len(effects) <= _MAX_NAMED:
        return '+ ' + ', '.join(effects)
    return f'+ {effects[0]} and {len(effects) - 1} more'


def warnings_of_fit(answer: Learned) -> tuple[str, ...]:
    """Return the warnings on a fitted model."""
    axes = answer.arm.axes
    warnings = [*answer.result.report.warnings]
    if axes.problem:
        warnings.append(f'{axes.problem}.')
    if axes.left_out:
        warnings.append(f'Omitted, because not part of the arm: {", ".join(axes.left_out)}.')
    return tuple(warnings)


def _command(stage: Stage, bags: tuple[Path, ...]) -> str:
    if stage.given is not None:
        return shlex.join(['cp', str(stage.given.resolve()), MODEL_FILE])
    choice = stage.choice
    if stage.effects:
        return add_command(stage.effects, choice, bags)
    return _line('fit', choice, bags, *choice.fit_options(), *choice.gate_options(), '-o',
                 MODEL_FILE, joints=True)


def _line(verb: str, choice: Choice, bags: tuple[Path, ...], *options: str,
          joints: bool = False) -> str:
    """Return a command line for the chosen recordings with their options of reading."""
    # Absolute paths, so that the command lines run in any folder.
    files = [str(bags[run].resolve()) for run in choice.runs]
    return f'gravity_comp {verb} ' + shlex.join(
        [*files, *options, *choice.options().words(joints=joints)])
