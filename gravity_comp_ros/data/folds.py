"""Held-out parts: whole runs where there are enough, else contiguous blocks of time."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, IntArray
import numpy as np

N_FOLDS = 5


def folds(runs: IntArray, n_folds: int = N_FOLDS) -> list[BoolArray]:
    """
    Return masks (M,) of test samples that together cover all samples once.

    Neighbours in time are not independent, so no sample is judged by a model that was fitted
    to the samples around it: a fold is one or more whole runs if there are at least three, and
    one contiguous block out of `n_folds` otherwise.
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
