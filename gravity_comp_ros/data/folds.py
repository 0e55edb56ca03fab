"""Folds for cross-validation: whole runs if there are enough, else contiguous blocks of time."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, IntArray
import numpy as np

N_FOLDS = 5


def folds(runs: IntArray, n_folds: int = N_FOLDS) -> list[BoolArray]:
    """
    Return masks (M,) of test samples that together cover all samples once.

    Samples are autocorrelated, so a held-out sample must not be next to fitted ones: a fold is
    one or more whole runs if there are at least three, otherwise one of `n_folds` contiguous
    blocks.
    """
    present = np.unique(runs)
    if len(present) >= 3:
        groups = np.array_split(present, min(n_folds, len(present)))
        return [np.isin(runs, group) for group in groups]
    blocks = np.array_split(np.arange(len(runs)), n_folds)
    masks = []
    for block in blocks:
        mask = np.zeros(len(runs), dtype=bool)
        mask[block] = True
        masks.append(mask)
    return masks
