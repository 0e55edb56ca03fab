"""Settings and stages of the model, with the command lines that reproduce them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import shlex

from gravity_comp_ros.api.axes import ArmOptions, NO_DESCRIPTION, WITH_AXES
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport
from gravity_comp_ros.recordings.read_options import option_words

# Model file in the exported command lines.
MODEL_FILE = 'arm.json'


@dataclass(frozen=True)
class Choice:
    """
    Chosen runs (by number) and joints, options of reading, and samples.

    The joints are those of `joints`, in this order. `urdf` is the robot description, None for that
    of the recordings; it gives the axes of a fit if `known_axes`. The model is fitted to and
    compared on the slow samples of the `gate`, all if it is None.
    """

    runs: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()
    formulation: str = FitOptions().formulation
    reading: ReadOptions = ReadOptions()
    gate: GateOptions | None = GateOptions()
    urdf: Path | None = None
    known_axes: bool = True

    @property
    def description(self) -> Path | str | None:
        """Return the description of the axes, in the notation of --urdf."""
        return self.urdf if self.known_axes else NO_DESCRIPTION

    def options(self) -> ReadOptions:
        """Return the options to read the recordings; what is refused is refused by each job."""
        return replace(self.reading, joints=self.joints or None, refuse=False)

    def learning(self, ordered: bool) -> ArmOptions:
        """
        Return the options of the fit.

        :param ordered: whether the joints are given in the order of the arm.
        """
        urdf = self.description if self.formulation in WITH_AXES else None
        return ArmOptions(self.formulation, urdf, ordered=ordered)

    def recording(self, samples: JointSamples, reports: Sequence[ReadReport]) -> Recording:
        """
        Return the chosen runs and joints of all recordings.

        :raises DataError: if no run is chosen.
        """
        runs = [samples.run(number) for number in self.runs]
        if not runs:
            raise DataError('no run is selected')
        return Recording(concatenate(runs).joints(self.joints), self.gate,
                         tuple(reports[number] for number in self.runs))

    def command(self, verb: str, paths: tuple[Path, ...], joints: bool = False,
                gated: bool = True, **options: object) -> str:
        """
        Return a command line for the chosen ones of all recordings, with their reading.

        :param gated: whether the verb has a gate; further options are by name.
        """
        gate = {'all_samples': self.gate is None, 'max_speed': self.gate and self.gate.max_speed,
                'rate': self.gate and self.gate.rate_hz} if gated else {}
        # Absolute paths, so that the command lines run in any folder.
        files = [str(paths[run].resolve()) for run in self.runs]
        return f'gravity_comp {verb} ' + shlex.join(
            [*files, *option_words({**options, **gate}), *self.options().words(joints=joints)])

    def add_command(self, effects: tuple[str, ...], paths: tuple[Path, ...],
                    model: Path | str = MODEL_FILE) -> str:
        """Return the command line that adds effects to a model file."""
        return self.command(f'add {shlex.quote(",".join(effects))}', paths, model=model)


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

    def command(self, paths: tuple[Path, ...]) -> str:
        """Return the command line of this step, for all recordings of the session."""
        if self.given is not None:
            return shlex.join(['cp', str(self.given.resolve()), MODEL_FILE])
        if self.effects:
            return self.choice.add_command(self.effects, paths)
        choice = self.choice
        return choice.command(
            'fit', paths, joints=True, output=MODEL_FILE, formulation=choice.formulation,
            urdf=choice.learning(True).urdf)
