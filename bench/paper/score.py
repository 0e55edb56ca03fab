"""Errors of a method on a scene, and the worst of several seeds."""

from __future__ import annotations

from dataclasses import dataclass

from bench.paper.methods import Method
from bench.paper.scenes import FloatArray, Judged, Scene
import numpy as np


@dataclass(frozen=True)
class Row:
    """
    One method: errors by joint (N,) in N·m, and the same over the torque's range (Eq. (16)).

    `measured` is against what sensors say on the motion, friction and noise in it; `inside` and
    `anywhere` against exact gravity, in the trained range and over all joint limits.
    """

    name: str
    n_samples: int
    features: list[int] | None
    seconds: float
    measured: FloatArray
    nrmse: FloatArray
    inside: FloatArray
    nrmse_inside: FloatArray
    anywhere: FloatArray
    nrmse_anywhere: FloatArray


def score(name: str, method: Method, scene: Scene) -> Row:
    """Learn and judge."""
    found = method(scene)
    predicted = found.predict(scene.inside.q)
    measured, nrmse = _errors(predicted, scene.inside.measured)
    inside, nrmse_inside = _errors(predicted, scene.inside.truth)
    anywhere, nrmse_anywhere = _errors(found.predict(scene.anywhere.q), scene.anywhere.truth)
    return Row(name, found.n_samples, found.features, found.seconds, measured, nrmse, inside,
               nrmse_inside, anywhere, nrmse_anywhere)


def worst(rows: list[Row]) -> Row:
    """Return the largest of everything over seeds."""
    first = rows[0]
    features = None if first.features is None else np.max(
        [row.features for row in rows], axis=0).tolist()

    def largest(key: str) -> FloatArray:
        return np.max([getattr(row, key) for row in rows], axis=0)
    return Row(first.name, first.n_samples, features, max(row.seconds for row in rows),
               *(largest(key) for key in ('measured', 'nrmse', 'inside', 'nrmse_inside',
                                          'anywhere', 'nrmse_anywhere')))


def _errors(predicted: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    rmse = np.sqrt(((predicted - target) ** 2).mean(axis=0))
    spread = np.ptp(target, axis=0)
    # A joint that carries less than this has no range to speak of.
    return rmse, np.where(spread > 1e-3, rmse / np.maximum(spread, 1e-3), np.nan)


def constant(judged: Judged) -> FloatArray:
    """Return the error (N,) of predicting the mean torque."""
    return judged.truth.std(axis=0)
