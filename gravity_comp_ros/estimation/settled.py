"""
Whether a model fitted to the samples alone has settled.

After a few seconds of motion, several arms explain the torques. A fit may then predict its
held-out samples well and be wrong by many N·m at other poses of their range, by more than its
standard deviation. More samples change such a model. So a model is compared with the fit to the
first part of its samples, at poses drawn from the range of the samples.
"""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, FitError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# The first part of the samples.
_EARLY = 0.7
_POSES = 300
# A model may still change by this part of the largest gravity torque in the box, and by so many
# times the noise. Of arms in MuJoCo with friction, models that were 4 to 10 N·m wrong changed by
# more, those that were right to 0.1 N·m by a tenth of it.
_SHARE, _NOISE = 0.1, 3.0


def unsettled(model: GravityModel, train: JointSamples, noise: FloatArray,
              fit_again: Callable[[JointSamples], GravityModel]) -> str | None:
    """
    Return by how much a model still changes with the samples, None if that is little.

    :param noise: of each joint (N,), N·m. :param fit_again: how `model` was fitted to `train`.
    """
    early = train.select(np.arange(len(train)) < round(_EARLY * len(train)))
    try:
        before = fit_again(early)
    except (FitError, DataError) as problem:
        return f'{len(early)} of {len(train)} samples make no model yet: {problem}'
    q = np.random.default_rng(0).uniform(train.q.min(axis=0), train.q.max(axis=0),
                                         (_POSES, train.n_joints))
    torque = model.predict(q)
    change = np.sqrt(((torque - before.predict(q)) ** 2).mean(axis=0))
    size = float(np.sqrt((torque ** 2).mean(axis=0)).max())
    allowed = _SHARE * size + _NOISE * noise
    worst = int(np.argmax(change / allowed))
    if change[worst] <= allowed[worst]:
        return None
    return (f'the model has not settled: the last {len(train) - len(early)} of {len(train)} '
            f'samples changed the torque of {train.names[worst]} by {change[worst]:.3g} N·m in '
            f'the range of the motion ({allowed[worst]:.3g} allowed)')
