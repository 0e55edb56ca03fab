"""Slow samples of one bag, with their accelerations at the rate of the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.data.acceleration import recorded_accelerations
from gravity_comp_ros.data.gate import GateOptions, slow_samples
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions, ReadReport


@dataclass(frozen=True, eq=False)
class GatedRecording:
    """
    Samples of one bag that passed the gate, and the number dropped by reason.

    `report.n_samples` is the number of samples before the gate. `qdd` (M, N) are accelerations in
    rad/s^2; None if the recording does not resolve starts and stops.
    """

    samples: JointSamples
    report: ReadReport
    dropped: dict[str, int]
    qdd: FloatArray | None

    def accelerations_of(self, names: Sequence[str]) -> FloatArray | None:
        """Return the accelerations of these joints, in this order; None if there are none."""
        columns = [self.samples.names.index(name) for name in names]
        return None if self.qdd is None else self.qdd[:, columns]


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
    return GatedRecording(gated.samples, whole.report, dict(gated.dropped),
                          recorded_accelerations(whole.samples, gated.samples))
