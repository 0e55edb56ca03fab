"""Cross-validation folds by pose: no run of the training set passes the held-out poses."""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.evaluation.blocks import Blocks, N_FOLDS
from gravity_comp_ros.models.least_squares import svd
import numpy as np

# Minimum spread of the blocks' mean poses, relative to the spread of all poses.
_MIN_SPREAD = 0.25


def pose_folds(samples: JointSamples, blocks: Blocks) -> Blocks | None:
    """
    Return the same blocks with folds by their mean pose; None if the mean poses hardly differ.

    Blocks are sorted along the first principal direction of their mean poses and divided into
    equal folds.
    """
    counts = np.diff(blocks.starts)
    mean = blocks.sums(samples.q) / counts[:, None]
    centred = mean - mean.mean(axis=0)
    spread = float(np.sqrt((centred ** 2).sum(axis=1).mean()))
    whole = float(np.sqrt(samples.q.var(axis=0).sum()))
    if spread <= _MIN_SPREAD * whole:
        return None
    along = centred @ svd(centred)[2][0]
    fold = np.empty(blocks.count, dtype=np.int64)
    fold[np.argsort(along, kind='stable')] = np.arange(blocks.count) * N_FOLDS // blocks.count
    return replace(blocks, fold=fold)
