"""
Held-out errors: every fold is predicted by the model of the other folds.

The posterior of a fold follows from the sums without its rows. Its model predicts the samples of
the fold as `compare` does, so that both errors are of the same kind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.predict import EffectInUse
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.estimate import Estimate
from gravity_comp_ros.estimation.estimated_model import model_of
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
import numpy as np


@dataclass(frozen=True, eq=False)
class HeldOutTorques:
    """
    Torques of held-out samples by part: `gravity` (U, N) and `effects` by target, in N·m.

    `tau` (U, N) is the measured torque of the U fitted samples; `run` (U,) numbers the runs.
    """

    tau: FloatArray
    gravity: FloatArray
    effects: Mapping[str, FloatArray]
    run: IntArray

    def residual(self, predicted: Collection[str]) -> FloatArray:
        """Return the residual (U, N) in N·m of gravity with some effects."""
        residual = self.tau - self.gravity
        for name in predicted:
            residual = residual - self.effects.get(name, 0.0)
        return np.asarray(residual)

    def rmse(self, predicted: Collection[str]) -> FloatArray:
        """Return the RMSE (N,) in N·m of gravity with some effects."""
        return np.asarray(np.sqrt((self.residual(predicted) ** 2).mean(axis=0)))


def held_out_torques(estimate: Estimate) -> HeldOutTorques:
    """
    Return the parts of the torque of every sample, from the model of the other folds.

    :raises DataError: if there are too few samples.
    """
    regression = estimate.regression
    problem = regression.problem
    samples, rows = problem.measured, problem.rows
    if rows.n_rows < OPTIONS.min_rows:
        raise DataError(f'{len(problem.used)} samples are too few to evaluate effects; record at '
                        f'least a minute')
    fold = rows.fold[problem.row_of]
    gravity = np.zeros((len(fold), samples.n_joints))
    effects: dict[str, FloatArray] = {}
    everything = [*(t.name for t in regression.terms), DYNAMICS]
    every_sample = Motion.of(samples, np.zeros_like(samples.q), problem.motion.gravity_gradient)
    for k in np.unique(rows.fold):
        posterior = regression.without(rows.fold == k)
        model = model_of(estimate, everything, posterior, with_noise=False)
        here = fold == k
        numbers = problem.used[here]
        motion = every_sample.with_gravity(
            model.predict(samples.q), partial(gravity_gradient, model), model.chain,
            model.geometry)
        gravity[here] = motion.gravity[numbers]
        part = replace(motion, samples=samples.select(numbers), qdd=motion.qdd[numbers],
                       gravity=gravity[here], memo={})
        for applied in (*model.applied.effects, *model.fitted.effects):
            each = EffectInUse.of(model, applied, motion)
            # Dynamics depend on the present state alone.
            torque = each.torque(part) if each.effect.is_shared else each.torque(motion)[numbers]
            effects.setdefault(applied.target, np.zeros_like(gravity))[here, each.joints] = torque
    return HeldOutTorques(samples.tau[problem.used], gravity, effects,
                          samples.runs[problem.used])
