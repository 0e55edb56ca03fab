"""
Whether a model fitted to the samples alone has settled.

After a few seconds of motion, several arms explain the torques. A fit may then predict its
held-out samples well and be wrong by many N·m at other poses of their range, by more than its
standard deviation. More samples change such a model, and so do fewer. So it is compared with fits
to the first and to the last part of its samples, at poses drawn from the range of the samples.
"""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, FitError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# The parts of the samples: the first ones, the last ones. Much less motion than there is settles
# nothing; a little less may be wrong in the same way.
_FIRST, _LAST = 0.85, 0.7
_POSES = 300
# A model may still change by this part of the largest gravity torque in the box, and by so many
# times the noise. Of arms in MuJoCo with friction, models that were 1 to 50 N·m wrong changed by
# more (one of 0.9 N·m did not), most of those that were right to 0.2 N·m by a tenth of it.
_SHARE, _NOISE = 0.1, 3.0


def unsettled(model: GravityModel, train: JointSamples, noise: FloatArray,
              fit_again: Callable[[JointSamples], GravityModel]) -> str | None:
    """
    Return by how much a model still changes with the samples, None if that is little.

    :param noise: of each joint (N,), N·m. :param fit_again: how `model` was fitted to `train`.
    """
    m, number = len(train), np.arange(len(train))
    q = np.random.default_rng(0).uniform(train.q.min(axis=0), train.q.max(axis=0),
                                         (_POSES, train.n_joints))
    torque = model.predict(q)
    allowed = _SHARE * float(np.sqrt((torque ** 2).mean(axis=0)).max()) + _NOISE * noise
    for which, rest in (('last', number < round(_FIRST * m)),
                        ('first', number >= m - round(_LAST * m))):
        part = train.select(rest)
        try:
            other = fit_again(part).predict(q)
        except (FitError, DataError) as problem:
            return f'{len(part)} of {m} samples make no model yet: {problem}'
        change = np.sqrt(((torque - other) ** 2).mean(axis=0))
        worst = int(np.argmax(change / allowed))
        if change[worst] > allowed[worst]:
            return (f'the model has not settled: the {which} {m - len(part)} of {m} samples '
                    f'changed the torque of {train.names[worst]} by {change[worst]:.3g} N·m in '
                    f'the range of the motion ({allowed[worst]:.3g} allowed)')
    return None
