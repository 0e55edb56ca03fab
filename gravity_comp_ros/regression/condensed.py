"""Samples of a fast recording, averaged to a few in each row."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.runs import run_time
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.rows import begins_group, mean_of, row_width
import numpy as np


@dataclass(frozen=True, eq=False)
class Condensed:
    """
    Means of groups of consecutive samples: `samples` (G), and `use` (G,) of those to fit.

    `group` (M,) is the number of the group of each measured sample.
    """

    samples: JointSamples
    use: BoolArray
    group: IntArray


def condensed(measured: JointSamples, use: BoolArray, options: EngineOptions) -> Condensed:
    """
    Return the means over groups of at most `row_samples` in a row, about `max_samples` in all.

    The columns of effects are computed at every sample, for every setting: more samples than
    resolve the motion within a row cost time and memory and change no mean. The torque of a row
    remains the mean of all its samples. Slow recordings are returned as they are.

    :param use: mask (M,) of the samples to fit; a group is fitted if most of its samples are.
    """
    t, width = run_time(measured), row_width(measured, use, options)
    rows = int(begins_group(t[use], measured.runs[use], measured.q[use], width, options).sum())
    per_row = min(options.row_samples, max(options.max_samples // max(rows, 1), 1))
    new = begins_group(t, measured.runs, measured.q, width / per_row, options)
    first = np.flatnonzero(new)
    if len(measured) < 2 * len(first):
        return Condensed(measured, use, np.arange(len(measured)))
    count = np.diff(np.append(first, len(measured)))

    def mean(values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(mean_of(values, first, count))

    samples = JointSamples(
        measured.names, mean(measured.t), mean(measured.q), mean(measured.qd),
        mean(measured.tau), measured.runs[first], measured.run_labels, measured.starts,
        None if measured.qdd is None else mean(measured.qdd), measured.fingerprints)
    share = np.add.reduceat(use.astype(np.float64), first) / count
    return Condensed(samples, share > 0.5 if (share > 0.5).any() else share > 0.0,
                     np.cumsum(new) - 1)
