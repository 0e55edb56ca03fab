"""Errors of a method on a scene, and their maximum over seeds."""

from __future__ import annotations

from dataclasses import dataclass

from bench.paper.methods import Method
from bench.paper.scenes import FloatArray, Scene
import numpy as np


@dataclass(frozen=True)
class Row:
    """
    Errors of one method by joint (N,) in N·m, and relative to the torque's range (Eq. (16)).

    `measured` is relative to the measured torque, with friction and noise; `inside` and `anywhere`
    are relative to exact gravity, in the trained range and over all joint limits.
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
    """Fit a method to a scene and return its errors."""
    fitted = method(scene)
    predicted = fitted.predict(scene.inside.q)
    measured, nrmse = _errors(predicted, scene.inside.measured)
    inside, nrmse_inside = _errors(predicted, scene.inside.truth)
    anywhere, nrmse_anywhere = _errors(fitted.predict(scene.anywhere.q), scene.anywhere.truth)
    return Row(name, fitted.n_samples, fitted.features, fitted.seconds, measured, nrmse, inside,
               nrmse_inside, anywhere, nrmse_anywhere)


def worst(rows: list[Row]) -> Row:
    """Return the maximum of every figure over seeds."""
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
    # nRMSE is undefined for a joint without gravity torque.
    return rmse, np.where(spread > 1e-3, rmse / np.maximum(spread, 1e-3), np.nan)
