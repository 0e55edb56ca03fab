"""Recordings from files: MCAP, rosbag2 folders and .db3, each file one run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gravity_comp_ros.api.gated import passed
from gravity_comp_ros.api.learn import known_arm
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate
if TYPE_CHECKING:
    # Needs the libraries of file formats, which arrays do without.
    from gravity_comp_ros.recordings.bag import ReadOptions, ReadReport
    from gravity_comp_ros.recordings.bag import Recording as BagRecording
    from gravity_comp_ros.recordings.gated_bag import GatedRecording


# Of all recordings together: those of seven joints then take 0.2 GB.
_MOST_MESSAGES = 1_000_000


def _silent(word: str, share: float) -> None:
    """Drop a report of progress."""


def read(paths: str | Path | Sequence[str | Path], *, topic: str | None = None,
         joints: Sequence[str] | None = None, effort_scale: Mapping[str, float] | None = None,
         differentiate: bool = False, gate: GateOptions | None = GateOptions(),
         progress: Progress = _silent) -> Recording:
    """
    Read recordings: MCAP files, rosbag2 folders or bare .db3 files, each one run.

    :param paths: one path, or several.
    :param topic: of the joint states; without, the only one there is, or `/joint_states`.
    :param joints: these joints, in this order. Without, those of the arm, in the order of the
        robot description in the recordings, or of numbers and words in the names; as recorded
        where neither says anything.
    :param effort_scale: N·m per unit of effort by joint, sign included; 1 where not given.
    :param differentiate: take velocities from the positions although there are some.
    :param gate: which samples count as slow; None takes all.
    :param progress: called with a word and a share from 0 to 1.
    :raises BagError: if a file cannot be read.
    :raises ModelMismatchError: if two recordings are of different robots.
    """
    from gravity_comp_ros.recordings.bag import ReadOptions
    files = [Path(paths)] if isinstance(paths, str | Path) else [Path(path) for path in paths]
    options = ReadOptions(topic, None if joints is None else tuple(joints), effort_scale or {},
                          differentiate)
    recording = read_recording(files, options, gate, progress)
    return recording if joints is not None else known_arm(recording).of(recording)


def read_recording(paths: Sequence[Path], options: ReadOptions, gate: GateOptions | None,
                   progress: Progress = _silent) -> Recording:
    """
    Return all samples of these files.

    :raises BagError: if a file cannot be read.
    :raises ModelMismatchError: if two recordings are of different robots.
    """
    found = read_each(paths, options, progress)
    kept, reports = _each_once([one.report for one in found])
    return Recording(concatenate(found[k].samples for k in kept), gate, reports)


def read_each(paths: Sequence[Path], options: ReadOptions,
              progress: Progress) -> list[BagRecording]:
    """
    Return each file as a run of its own.

    :raises BagError: if a file cannot be read.
    :raises ModelMismatchError: if one lacks a joint that the options name.
    """
    from gravity_comp_ros.recordings.bag import read_bag
    found, options = [], _bounded(options, len(paths))
    for number, path in enumerate(paths):
        progress(f'read {path.name}', number / len(paths))
        found.append(read_bag(path, options))
    return found


def _bounded(options: ReadOptions, n_files: int) -> ReadOptions:
    """Return the options with a share of what is read at most for each file."""
    return options if options.most is not None else replace(
        options, most=max(_MOST_MESSAGES // max(n_files, 1), 1))


def _each_once(reports: Sequence[ReadReport]) -> tuple[list[int], tuple[ReadReport, ...]]:
    """Return which recordings are no copies, and their reports with a note on the copies."""
    digests = [report.sha256 for report in reports]
    kept = [k for k, digest in enumerate(digests) if digest not in digests[:k]]
    found = []
    for k in kept:
        notes = [f'{other.path} is the same recording and counts once'
                 for other in reports[k + 1:] if other.sha256 == digests[k]]
        found.append(replace(reports[k], notes=(*reports[k].notes, *notes)))
    return kept, tuple(found)


def read_slow(paths: Sequence[Path], options: ReadOptions, gate: GateOptions | None,
              progress: Progress = _silent) -> Recording:
    """
    Return the slow samples of these files alone, for a fit of gravity without effects.

    The others are never held in memory, and large files are read in parallel processes.

    :raises BagError: if a file cannot be read.
    :raises ModelMismatchError: if two recordings are of different robots.
    :raises DataError: if no sample is slow.
    """
    if gate is None:
        return read_recording(paths, options, gate, progress)
    from gravity_comp_ros.recordings.parallel import read_gated_bags
    coming, found = read_gated_bags(paths, _bounded(options, len(paths)), gate), []
    for number, path in enumerate(paths):
        progress(f'read {path.name}', number / len(paths))
        found.append(next(coming))
    return gated_recording(found, gate)


def gated_recording(found: Sequence[GatedRecording], gate: GateOptions) -> Recording:
    """
    Return the slow samples of several files as one recording; a copy of another counts once.

    :raises DataError: if no sample is slow.
    """
    kept, reports = _each_once([one.report for one in found])
    samples = concatenate(found[k].samples for k in kept)
    dropped = sum((Counter(found[k].dropped) for k in kept), Counter())
    total = sum(report.n_samples for report in reports)
    return Recording(samples, gate, reports, gated_before=passed(samples, total, dropped, gate))
