"""Slow samples of one bag, with their accelerations at the rate of the recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.data.gate import GateOptions, slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions, ReadReport


@dataclass(frozen=True, eq=False)
class GatedRecording:
    """
    Samples of one bag that passed the gate, and the number dropped by reason.

    `report.n_samples` is the number of samples before the gate.
    """

    samples: JointSamples
    report: ReadReport
    dropped: dict[str, int]


def read_gated(path: str | Path, options: ReadOptions = ReadOptions(),
               gate: GateOptions = GateOptions()) -> GatedRecording:
    """
    Return the slow samples of one bag.

    :raises BagError: as `read_bag`.
    :raises ModelMismatchError: as `read_bag`.
    :raises OptionError: if the number of thresholds of the gate is not the number of joints.
    """
    whole = read_bag(path, options)
    gated = slow_samples(whole.samples, gate)
    return GatedRecording(gated.samples, whole.report, dict(gated.dropped))
