"""
Stability of a model over subsets of its samples.

After a few seconds of motion several arms explain the torques. The held-out error of a fit may
then be small while its error at other poses of the range is many N·m, far above its standard
deviation. Such a model changes with more or fewer samples. It is therefore compared with fits to
the first and to the last part of its samples, at random poses within their range.
"""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, FitError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Shares of the samples: the first ones, and the last ones. Much smaller subsets change any model;
# slightly smaller ones may have the same error.
_FIRST, _LAST = 0.85, 0.7
# Maximum change of the torque: this share of the largest gravity torque in the range, plus this
# multiple of the noise. Of arms in MuJoCo with friction, models with an error of 1 to 50 N·m
# changed by more (one of 0.9 N·m did not), most of those within 0.2 N·m by a tenth of it.
_MAX_SHARE, _MAX_NOISE = 0.1, 3.0


def last_part(samples: JointSamples) -> JointSamples:
    """Return the last samples, which must show what the whole shows."""
    m = len(samples)
    return samples.select(np.arange(m) >= m - round(_LAST * m))


def convergence_objection(model: GravityModel, train: JointSamples, noise: FloatArray,
                          fit_again: Callable[[JointSamples], GravityModel]) -> str | None:
    """
    Return a sentence on a large change of the model with the samples, None if it is stable.

    :param noise: of each joint (N,), N·m.
    :param fit_again: the fit that gave `model` from `train`.
    """
    m = len(train)
    q = random_poses(train.n_joints, train.q.min(axis=0), train.q.max(axis=0))
    torque = model.predict(q)
    allowed = _MAX_SHARE * float(np.sqrt((torque ** 2).mean(axis=0)).max()) + _MAX_NOISE * noise
    for left_out, part in (('last', train.select(np.arange(m) < round(_FIRST * m))),
                           ('first', last_part(train))):
        try:
            other = fit_again(part).predict(q)
        except (FitError, DataError) as problem:
            return f'{len(part)} of {m} samples are too few for a model: {problem}'
        change = np.sqrt(((torque - other) ** 2).mean(axis=0))
        worst = int(np.argmax(change / np.maximum(allowed, 1e-12)))
        if change[worst] > allowed[worst]:
            return (f'the model has not converged: the {left_out} {m - len(part)} of {m} samples '
                    f'changed the torque of {train.names[worst]} by {change[worst]:.3g} N·m in '
                    f'the range of the motion ({allowed[worst]:.3g} allowed)')
    return None
