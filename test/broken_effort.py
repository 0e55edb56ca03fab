"""Efforts that a driver, a sensor or a wire may report instead of the true torque."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

Break = Callable[[FloatArray, np.random.Generator], FloatArray]

# N·m; what a sensor still shows when nothing drives it.
IDLE = 0.1
SHOULDER, ELBOW, WRIST = 1, 3, 5


def drives_off(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return IDLE * rng.standard_normal(tau.shape)


def zero(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.zeros_like(tau)


def dead(joint: int) -> Break:
    def broken(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
        found = tau.copy()
        found[:, joint] = IDLE * rng.standard_normal(len(tau))
        return found
    return broken


def frozen(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.broadcast_to(tau[0], tau.shape).copy()


def frozen_joint(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    found = tau.copy()
    found[:, SHOULDER] = tau[0, SHOULDER]
    return found


def flipped(joint: int) -> Break:
    def broken(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
        found = tau.copy()
        found[:, joint] *= -1.0
        return found
    return broken


def all_flipped(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return -tau


def another_unit(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return 0.1 * tau


def one_gain(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    found = tau.copy()
    found[:, SHOULDER] *= 0.5
    return found


def saturated(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.clip(tau, -0.25 * np.abs(tau).max(), 0.25 * np.abs(tau).max())


def swapped(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    order = np.arange(tau.shape[1])
    order[[SHOULDER, ELBOW]] = ELBOW, SHOULDER
    return tau[:, order]


def external(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return effort less the gravity of a driver's own model, which is 3 % wrong."""
    return 0.03 * tau + IDLE * rng.standard_normal(tau.shape)


KINDS: Mapping[str, Break] = {
    'drives off': drives_off, 'zero': zero, 'dead shoulder': dead(SHOULDER),
    'dead elbow': dead(ELBOW), 'frozen': frozen, 'frozen shoulder': frozen_joint,
    'flipped shoulder': flipped(SHOULDER), 'flipped elbow': flipped(ELBOW),
    'all flipped': all_flipped, 'another unit': another_unit, 'one gain': one_gain,
    'saturated': saturated, 'swapped': swapped, 'gravity taken off': external}
