"""Recordings from MCAP files, rosbag2 folders and .db3 files, one run each; facts on joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gravity_comp_ros.api.axes import known_arm, KnownArm
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.description.joint_order import NAMES
from gravity_comp_ros.errors import BagError, DataError
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.facts.fact import Fact, refused, unless_accepted
from gravity_comp_ros.models.gravity_model import GravityModel

if TYPE_CHECKING:
    from gravity_comp_ros.estimation.torque_facts import WholeArm
    # Imports file-format libraries, which arrays do not need.
    from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport
    from gravity_comp_ros.recordings.bag import Recording as BagRecording


# Maximum number of messages read from all files together: 0.2 GB of memory for seven joints.
_MAX_MESSAGES = 1_000_000


def _silent(step: str, fraction: float) -> None:
    """Ignore progress."""


def read(paths: str | Path | Sequence[str | Path], *, topic: str | None = None,
         joints: Sequence[str] | None = None, effort_scale: Mapping[str, float] | None = None,
         differentiate: bool = False, gate: GateOptions | None = GateOptions(),
         accept: Sequence[str] = (), progress: Progress = _silent) -> Recording:
    """
    Read joint states from MCAP files, rosbag2 folders or .db3 files; each path is one run.

        data = gc.read(['run1.mcap', 'run2.mcap'], effort_scale={'elbow': -0.5})

    :param paths: one path, or several.
    :param topic: the JointState topic. The default is the only one with messages, or
        `/joint_states`.
    :param joints: names of the joints, in the order of the arm. The default is the joints of the
        arm, in the order of the robot description in the recordings; without a description, all
        joints, in the order given by the numbers and words in their names, else as recorded.
    :param effort_scale: torque per unit of effort, N·m, sign included, by joint; default 1.
    :param differentiate: compute velocities from positions even if velocities are recorded.
    :param gate: limits for slow samples; None uses all samples.
    :param accept: kinds of facts, such as `effort_gain`, for which the recording is neither
        corrected nor refused, by any step.
    :param progress: called with the name of the step and its completed fraction, 0 to 1.
    :raises BagError: if a file cannot be read.
    :raises ModelMismatchError: if the recordings have different joints.
    """
    from gravity_comp_ros.recordings.bag import ReadOptions
    files = [Path(paths)] if isinstance(paths, str | Path) else [Path(path) for path in paths]
    options = ReadOptions(topic, None if joints is None else tuple(joints), effort_scale or {},
                          differentiate, accept=tuple(accept))
    recording = read_recording(files, options, gate, progress)
    return recording if joints is not None else known_arm(recording).of(recording)


def read_recording(paths: Sequence[Path], options: ReadOptions, gate: GateOptions | None,
                   progress: Progress = _silent) -> Recording:
    """
    Return all samples of these files as one recording; copies of a file are ignored.

    :raises BagError: if a file cannot be read.
    :raises ModelMismatchError: if the recordings have different joints.
    """
    return joined(read_each(paths, options, progress), gate)


def joined(runs: Sequence[BagRecording], gate: GateOptions | None) -> Recording:
    """
    Return the files that were read as one recording; copies of a file are ignored.

    :raises ModelMismatchError: if the recordings have different joints.
    """
    kept, reports = _without_copies([run.report for run in runs])
    return Recording(concatenate(runs[k].samples for k in kept), gate, reports)


def read_each(paths: Sequence[Path], options: ReadOptions,
              progress: Progress) -> list[BagRecording]:
    """
    Return each file as a separate run.

    :raises BagError: if a file cannot be read.
    :raises ModelMismatchError: if a joint named in the options is missing in a file.
    """
    from gravity_comp_ros.recordings.bag import read_bag
    runs, options = [], bounded(options, len(paths))
    for number, path in enumerate(paths):
        progress(f'read {path.name}', number / len(paths))
        runs.append(read_bag(path, options))
        # Numbers of joints are those of the first file, whose order others may not have.
        options = runs[-1].report.options
    return runs


def bounded(options: ReadOptions, n_files: int) -> ReadOptions:
    """Return the options with a limit on the messages of each file, unless one is set."""
    return options if options.max_messages is not None else replace(
        options, max_messages=max(_MAX_MESSAGES // max(n_files, 1), 1))


def _without_copies(reports: Sequence[ReadReport]) -> tuple[list[int], tuple[ReadReport, ...]]:
    """Return the indices of distinct recordings, and their reports with notes on copies."""
    digests = [report.sha256 for report in reports]
    kept = [k for k, digest in enumerate(digests) if digest not in digests[:k]]
    noted = []
    for k in kept:
        notes = [f'{other.path} is a copy of this recording and is ignored'
                 for other in reports[k + 1:] if other.sha256 == digests[k]]
        noted.append(replace(reports[k], file_notes=(*reports[k].file_notes, *notes)))
    return kept, tuple(noted)


def arm_facts(recording: Recording, arm: KnownArm | None = None,
              model: GravityModel | None = None, min_ratio: float = OPTIONS.min_ratio,
              refuse: bool = True) -> tuple[Fact, ...]:
    """
    Return the facts on the order of the names, axes, gains, and the vertical; none of arrays.

    :param arm: axes and joint order; None for those of the model.
    :param model: see `torque_facts`.
    :param min_ratio: of gains that are refused.
    :param refuse: whether to check them.
    :raises DataError: if one of those to check is refused.
    """
    if not recording.reports:
        return ()
    from gravity_comp_ros.estimation.torque_facts import torque_facts  # imports SciPy
    rotations, by_name = None, False
    if arm is not None:
        recording, geometry = arm.of(recording), arm.geometry
        rotations = None if geometry is None else geometry.rotations
        by_name = geometry is None and arm.order.source == NAMES
    facts = torque_facts(recording.samples, rotations, model, _whole_arm(recording), by_name,
                         min_ratio)
    facts = [unless_accepted(fact, recording.reports[0].options.accept) for fact in facts]
    if refuse:
        check_facts(facts)
    return tuple(facts)


def check_facts(facts: Sequence[Fact], where: str = '') -> None:
    """
    Check that no fact is refused.

    :param where: the recording, before the refusal.
    :raises DataError: if one is.
    """
    for fact in refused(facts):
        raise DataError(f'{where}: ' * bool(where) + fact.sentence)


def _whole_arm(recording: Recording) -> WholeArm:
    """Return the reader of the recordings with the joints that their options leave out."""
    def read() -> JointSamples | None:
        every = replace(recording.reports[0].options, joints=None, refuse=False)
        try:
            whole = read_recording([each.path for each in recording.reports], every, None)
        except BagError:
            return None
        return known_arm(whole).of(whole).samples
    return read
