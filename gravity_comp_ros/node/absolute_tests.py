"""
Tests of a new model that do not ask whether it beats the old one on the same data.

Broken effort repeats in training and in held-out samples, so that a model of it beats the right
model on both. These tests ask the noise of earlier epochs, the structure of the arm, and whether
the joints agree with each other.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.noise import of_second_differences
import numpy as np

# A part of the largest torque below which no residual is called large, per joint.
LEAST_NOISE = 2e-3
# Without a chain: a residual of so many times the noise, or this part of the change, is too much.
LOOSE_RESIDUAL, PART_OF_CHANGE = 4.0, 0.15
# A first model leaves at most this part of a joint's own variation, or of the largest one.
OWN_PART, LARGEST_PART = 0.35, 0.1
# The least part of the arm's own gravity that a new payload leaves in the effort. Taking 5 kg off
# an iiwa leaves 0.58 of it.
OWN_GRAVITY = 0.25
# A joint carried gravity if that was so many times the noise. It carries none if this part of it
# is left, or so many times the noise: the friction of the model before is taken off an effort that
# has none. What a payload takes off a joint, it takes off some joint nearer the base as well, at
# least to this part.
_LOADED, _LEFT, _NOTHING, _NEARER = 6.0, 0.2, 4.0, 1.0 / 3.0
# Neighbours in time of which differences are noise, s.
_NEIGHBOURS = 0.6


def reference_noise(known: FloatArray, samples: JointSamples, predicted: FloatArray) -> FloatArray:
    """
    Return the noise (N,) in N·m that a residual is compared with.

    It is that of earlier epochs. A sensor that is noisier today than in training is no reason to
    refuse a payload, so the noise of `samples` counts where it is larger: what differs from
    sample to sample of their residual, which no change of gravity does.
    """
    least = LEAST_NOISE * float(np.abs(samples.tau).max(initial=0.0)) + 1e-9
    return np.maximum(np.maximum(known, least), _sample_noise(samples, samples.tau - predicted))


def _sample_noise(samples: JointSamples, residual: FloatArray) -> FloatArray:
    near = (np.diff(samples.t) < _NEIGHBOURS) & (np.diff(samples.runs) == 0)
    triples = near[1:] & near[:-1]
    if triples.sum() < 5:
        return np.zeros(residual.shape[1])
    return of_second_differences(residual, triples)


def first_model_objection(train: JointSamples, residual: FloatArray) -> str | None:
    """
    Return why a first model contradicts its own samples, None if it does not.

    The torques of an arm share one energy. Where one joint's effort is broken, no energy explains
    it beside the others.

    :param residual: RMS of what the model leaves of each joint (N,), N·m.
    """
    spread = train.tau.std(axis=0)
    allowed = np.maximum(OWN_PART * spread, LARGEST_PART * float(spread.max(initial=0.0)))
    worst = int(np.argmax(residual / np.maximum(allowed, 1e-9)))
    if residual[worst] <= allowed[worst]:
        return None
    return (f'the effort of {train.names[worst]} contradicts that of the other joints: residual '
            f'{residual[worst]:.3g} N·m of {spread[worst]:.3g} N·m')


def loose_objection(train: JointSamples, residual: FloatArray, noise: FloatArray,
                    change: FloatArray) -> str | None:
    """
    Return why a change is refused where no chain explains the arm, None if it is not.

    :param residual: RMS of what the new model leaves (N,), N·m.
    :param change: RMS of new minus old torque (N,), N·m.
    """
    allowed = np.maximum(LOOSE_RESIDUAL * noise, PART_OF_CHANGE * change)
    worst = int(np.argmax(residual / allowed))
    if residual[worst] <= allowed[worst]:
        return None
    return (f'the new model does not explain the effort of {train.names[worst]}: residual '
            f'{residual[worst]:.3g} N·m, noise of earlier epochs {noise[worst]:.3g}')


def lost_gravity(samples: JointSamples, before: FloatArray, noise: FloatArray) -> str | None:
    """
    Return a sentence where the effort follows less than `OWN_GRAVITY` of the old gravity.

    :param before: torque of the model before the change (M, N), N·m.
    """
    weighted, measured = before / noise, samples.tau / noise
    power = float((weighted ** 2).sum())
    if power < 25.0 * before.size:
        return None
    factor = float((weighted * measured).sum()) / power
    if factor >= OWN_GRAVITY:
        return None
    return (f'the effort holds {factor:.0%} of the gravity of the arm itself: drives off, gravity '
            'taken off by the driver, or another unit or sign')


def dead_joint(samples: JointSamples, before: FloatArray, noise: FloatArray) -> str | None:
    """
    Return a sentence where one joint has lost all its gravity, and nothing else has changed.

    :param samples: without friction and offset.
    :param before: torque of the model before the change (M, N), N·m.
    """
    was, now, change = (np.sqrt((torque ** 2).mean(axis=0))
                        for torque in (before, samples.tau, samples.tau - before))
    loaded = was > _LOADED * noise
    for joint in np.flatnonzero(loaded & (now < np.maximum(_NOTHING * noise, _LEFT * was))):
        if joint and change[:joint].max() < _NEARER * was[joint]:
            return (f'the effort of {samples.names[joint]} is {now[joint]:.2g} N·m where gravity '
                    f'was {was[joint]:.2g} N·m, and no joint before it has changed: its sensor or '
                    'its drive is dead')
    return None
