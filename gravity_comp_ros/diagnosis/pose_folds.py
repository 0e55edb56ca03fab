"""Folds that leave out poses: what a fold holds out was not seen on another run of the path."""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.evaluation.blocks import Blocks, N_FOLDS
from gravity_comp_ros.models.least_squares import svd
import numpy as np

# The poses of blocks must lie this much farther apart than within a block, or none is new.
_APART = 0.25


def pose_folds(samples: JointSamples, blocks: Blocks) -> Blocks | None:
    """
    Return the same blocks with folds by their mean pose; None if all blocks have the same.

    Blocks are put in order along the direction in which their mean poses differ most, and cut
    into equal parts.
    """
    counts = np.diff(blocks.starts)
    mean = blocks.sums(samples.q) / counts[:, None]
    centred = mean - mean.mean(axis=0)
    spread = float(np.sqrt((centred ** 2).sum(axis=1).mean()))
    whole = float(np.sqrt(samples.q.var(axis=0).sum()))
    if spread <= _APART * whole:
        return None
    along = centred @ svd(centred)[2][0]
    fold = np.empty(blocks.count, dtype=np.int64)
    fold[np.argsort(along, kind='stable')] = np.arange(blocks.count) * N_FOLDS // blocks.count
    return replace(blocks, fold=fold)
