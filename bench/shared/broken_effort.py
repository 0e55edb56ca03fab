"""Broken efforts of a driver, a sensor or a cable, from the true torque."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

Break = Callable[[FloatArray, np.random.Generator], FloatArray]

# Noise of a sensor without torque, N·m.
IDLE = 0.1
SHOULDER, ELBOW = 1, 3


def drives_off(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return IDLE * rng.standard_normal(tau.shape)


def zero(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.zeros_like(tau)


def dead(joint: int) -> Break:
    def broken(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
        effort = tau.copy()
        effort[:, joint] = IDLE * rng.standard_normal(len(tau))
        return effort
    return broken


def frozen(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.broadcast_to(tau[0], tau.shape).copy()


def frozen_joint(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    effort = tau.copy()
    effort[:, SHOULDER] = tau[0, SHOULDER]
    return effort


def flipped(joint: int) -> Break:
    def broken(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
        effort = tau.copy()
        effort[:, joint] *= -1.0
        return effort
    return broken


def all_flipped(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return -tau


def another_unit(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return 0.1 * tau


def one_gain(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    effort = tau.copy()
    effort[:, SHOULDER] *= 0.5
    return effort


def saturated(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.clip(tau, -0.25 * np.abs(tau).max(), 0.25 * np.abs(tau).max())


def swapped(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    order = np.arange(tau.shape[1])
    order[[SHOULDER, ELBOW]] = ELBOW, SHOULDER
    return tau[:, order]


def external(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return effort minus the gravity of a driver's own model with an error of 3 %."""
    return 0.03 * tau + IDLE * rng.standard_normal(tau.shape)


def intermittent_brake(tau: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return effort with a brake that engages for half a second, every few seconds."""
    effort, k = tau.copy(), int(rng.integers(5, 15))
    while k < len(effort):
        effort[k:k + 3, int(rng.integers(0, 5))] += rng.choice([-1.0, 1.0]) * 10.0
        k += int(rng.integers(20, 60))
    return effort


KINDS: Mapping[str, Break] = {
    'drives off': drives_off, 'zero': zero, 'dead shoulder': dead(SHOULDER),
    'dead elbow': dead(ELBOW), 'frozen': frozen, 'frozen shoulder': frozen_joint,
    'flipped shoulder': flipped(SHOULDER), 'flipped elbow': flipped(ELBOW),
    'all flipped': all_flipped, 'another unit': another_unit, 'one gain': one_gain,
    'saturated': saturated, 'swapped': swapped, 'gravity subtracted': external}
