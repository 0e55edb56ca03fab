"""
Added-variable plots: the part of the torque that an effect explains in addition to gravity.

X are the regressor columns of the effect, Z those of gravity and all other effects of the joint.
Both axes are projected on the orthogonal complement of Z: x = X c and y = tau, with c from least
squares. A present effect gives points along the line y = x. A curved pattern, or a line
determined by a few points, is evidence against the effect.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.effects.effect import Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.least_squares import lstsq, svd
from gravity_comp_ros.models.sparse import dictionary
import numpy as np

# Maximum number of gravity terms for a refit; beyond it the residual of the model is used.
_MAX_FEATURES = 500


@dataclass(frozen=True)
class AddedVariable:
    """
    Added-variable plot of a finding, for R samples: `x` and `y` (R,) in N·m.

    `joint` is the joint of the torque. For an unexplained residual x is the joint angle in rad
    and `is_angle` is set.
    """

    finding: Finding
    joint: str
    x: FloatArray
    y: FloatArray
    is_angle: bool = False

    @property
    def share(self) -> float:
        """Return the share of the variance of y that the line explains, 0 to 1."""
        total = float((self.y ** 2).sum())
        return 1.0 - float(((self.y - self.x) ** 2).sum()) / total if total > 0.0 else 0.0


def added_variable(motion: Motion, model: GravityModel, finding: Finding,
                   others: list[Finding], rows: IntArray) -> AddedVariable | None:
    """
    Return the added-variable plot of a finding; None if this motion gives no columns.

    :param motion: motion of all samples, as recorded.
    :param others: other findings, whose columns are part of Z.
    :param rows: indices of the samples to plot (R,).
    """
    if finding.joint is not None and finding.joint not in model.joints:
        return None
    if finding.effect is None:
        joint = model.joints.index(finding.joint) if finding.joint else 0
        residual = _project(motion, model, joint, others, rows)[1]
        return AddedVariable(finding, model.joints[joint], motion.samples.q[rows, joint], residual,
                             True)
    columns = _columns(motion, model, finding.effect, finding.joint, finding.setting)
    if columns is None:
        return None
    joints = range(model.n_joints) if columns.ndim == 3 else [
        model.joints.index(finding.joint or model.joints[0])]
    best: AddedVariable | None = None
    best_norm = -1.0
    for joint in joints:
        effect_columns = (columns[:, joint] if columns.ndim == 3 else columns)[rows]
        basis, residual = _project(motion, model, joint, others, rows)
        effect_columns = effect_columns - basis @ (basis.T @ effect_columns)
        x = effect_columns @ lstsq(effect_columns, residual, rcond=1e-8)
        if float(x @ x) > best_norm:
            best = AddedVariable(finding, model.joints[joint], x, residual)
            best_norm = float(x @ x)
    return best


def _project(motion: Motion, model: GravityModel, joint: int, others: list[Finding],
             rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return an orthonormal basis (R, K) of Z, and the residual torque (R,) in N·m."""
    samples = motion.samples
    features = model.torques[joint].indices
    tau = samples.tau[rows, joint]
    regressors = [np.zeros((len(rows), 0))]
    if len(features) <= min(_MAX_FEATURES, len(rows) // 4):
        regressors.append(dictionary.columns(samples.q[rows], features))
    else:
        tau = tau - motion.gravity[rows, joint]
    effects: list[tuple[str, str | None, Setting]] = [
        (e.name, e.joint, e.setting) for e in model.applied.effects]
    effects += [(f.effect, f.joint, f.setting) for f in others if f.effect is not None]
    for name, joint_name, setting in effects:
        columns = _columns(motion, model, name, joint_name, setting)
        if columns is None or (columns.ndim == 2 and joint_name != model.joints[joint]):
            continue
        regressors.append((columns[:, joint] if columns.ndim == 3 else columns)[rows])
    basis, singular_values, _ = svd(np.hstack(regressors))
    basis = basis[:, singular_values > 1e-9 * max(singular_values, default=0.0)]
    return basis, tau - basis @ (basis.T @ tau)


def _columns(motion: Motion, model: GravityModel, name: str, joint: str | None,
             setting: Setting) -> FloatArray | None:
    effect = all_effects().get(name)
    if effect is None:
        return None
    index = 0 if joint is None else model.joints.index(joint)
    try:
        return effect.columns(motion, index, setting)
    except (KeyError, ValueError, IndexError):
        return None
