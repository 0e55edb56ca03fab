"""
Plausibility of the effort that a new model was fitted to.

Broken effort repeats in training and held-out samples, so a model of broken effort has a smaller
held-out error than the correct model. These tests compare with quantities that broken effort does
not change: the noise of earlier epochs, the structure of the arm, the agreement of the joints.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.noise import of_second_differences
import numpy as np

# Smallest noise, as a fraction of the largest torque of the samples.
MIN_NOISE_FRACTION = 2e-3
# Largest residual of a change without a chain: in units of noise, and as a fraction of the change.
MAX_RESIDUAL, MAX_RESIDUAL_OF_CHANGE = 4.0, 0.15
# Largest residual of a first model, as a fraction of the standard deviation of the joint's own
# torque and of the largest one.
MAX_OWN_FRACTION, MAX_LARGEST_FRACTION = 0.35, 0.1
# Smallest fraction of the arm's own gravity in the effort of a new payload. Without a tool of
# 5 kg the fraction is 0.58 on an iiwa.
MIN_GRAVITY = 0.25
# A joint is loaded where its gravity exceeds this many times the noise.
_LOADED = 6.0
# A loaded joint has lost its gravity where its torque is below this fraction of the gravity, or
# below this many times the noise (friction of the old model is subtracted from the effort).
_LOST_FRACTION, _LOST_NOISE = 0.2, 4.0
# Minimum relative change of a joint nearer the base by a payload that is removed.
_INNER_CHANGE = 1.0 / 3.0
# Largest time between consecutive samples whose differences count as noise, s.
_MAX_INTERVAL = 0.6


def reference_noise(expected: FloatArray, samples: JointSamples,
                    predicted: FloatArray) -> FloatArray:
    """
    Return the noise (N,) in N·m to compare a residual with.

    It is the larger of the noise of earlier epochs and the noise of `samples`, estimated from
    second differences of their residual. Gravity hardly contributes to second differences, so a
    sensor with more noise than in the training does not prevent a payload from being accepted.

    :param expected: noise of earlier epochs (N,), N·m.
    """
    floor = MIN_NOISE_FRACTION * float(np.abs(samples.tau).max(initial=0.0)) + 1e-9
    return np.maximum(np.maximum(expected, floor), _sample_noise(samples, samples.tau - predicted))


def _sample_noise(samples: JointSamples, residual: FloatArray) -> FloatArray:
    near = (np.diff(samples.t) < _MAX_INTERVAL) & (np.diff(samples.runs) == 0)
    triples = near[1:] & near[:-1]
    if triples.sum() < 5:
        return np.zeros(residual.shape[1])
    return of_second_differences(residual, triples)


def first_model_objection(train: JointSamples, residual: FloatArray) -> str | None:
    """
    Return why a first model contradicts its own samples, None if it does not.

    The torques of an arm share one potential energy. Where the effort of one joint is broken, no
    energy explains it together with the other joints.

    :param residual: RMS residual of the model (N,), N·m.
    """
    spread = train.tau.std(axis=0)
    allowed = np.maximum(MAX_OWN_FRACTION * spread,
                         MAX_LARGEST_FRACTION * float(spread.max(initial=0.0)))
    worst = int(np.argmax(residual / np.maximum(allowed, 1e-9)))
    if residual[worst] <= allowed[worst]:
        return None
    return (f'the effort of {train.names[worst]} contradicts that of the other joints: residual '
            f'{residual[worst]:.3g} N·m of {spread[worst]:.3g} N·m')


def objection_without_chain(train: JointSamples, residual: FloatArray, noise: FloatArray,
                            change: FloatArray) -> str | None:
    """
    Return why a change is refused where no chain explains the arm, None if it is not.

    :param residual: RMS residual of the new model (N,), N·m.
    :param change: RMS of new minus old torque (N,), N·m.
    """
    allowed = np.maximum(MAX_RESIDUAL * noise, MAX_RESIDUAL_OF_CHANGE * change)
    worst = int(np.argmax(residual / allowed))
    if residual[worst] <= allowed[worst]:
        return None
    return (f'the new model does not explain the effort of {train.names[worst]}: residual '
            f'{residual[worst]:.3g} N·m, noise of earlier epochs {noise[worst]:.3g} N·m')


def lost_gravity_objection(samples: JointSamples, before: FloatArray,
                           noise: FloatArray) -> str | None:
    """
    Return an objection where the effort contains less than `MIN_GRAVITY` of the old gravity.

    :param before: torque of the model before the change (M, N), N·m.
    """
    weighted, measured = before / noise, samples.tau / noise
    power = float((weighted ** 2).sum())
    if power < 25.0 * before.size:
        return None
    factor = float((weighted * measured).sum()) / power
    if factor >= MIN_GRAVITY:
        return None
    return (f'the effort contains {factor:.0%} of the gravity of the arm itself: drives off, '
            'gravity subtracted by the driver, or another unit or sign')


def dead_joint_objection(samples: JointSamples, before: FloatArray,
                         noise: FloatArray) -> str | None:
    """
    Return an objection where one joint has lost its gravity and no joint before it has changed.

    :param samples: without friction and offset.
    :param before: torque of the model before the change (M, N), N·m.
    """
    was, now, change = (np.sqrt((torque ** 2).mean(axis=0))
                        for torque in (before, samples.tau, samples.tau - before))
    loaded = was > _LOADED * noise
    lost = now < np.maximum(_LOST_NOISE * noise, _LOST_FRACTION * was)
    for joint in np.flatnonzero(loaded & lost):
        if joint and change[:joint].max() < _INNER_CHANGE * was[joint]:
            return (f'the effort of {samples.names[joint]} is {now[joint]:.2g} N·m where gravity '
                    f'was {was[joint]:.2g} N·m, and no joint before it has changed: its sensor or '
                    'its drive is dead')
    return None
