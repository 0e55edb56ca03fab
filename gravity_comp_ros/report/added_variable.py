"""
Added-variable plots: what an effect explains that gravity and the other effects cannot.

With the columns X of the effect and those Z of gravity and all other effects of the joint, both
sides are freed of Z: x = (X c) without Z, y = tau without Z, c from least squares. Points along
a straight line y = x are what an effect that is really there looks like; a bend, or a few points
that carry the line, speak against it.
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

# Gravity with more terms than this is not fitted again; its residual is taken as it is.
_MOST_FEATURES = 500


@dataclass(frozen=True)
class AddedVariable:
    """
    One finding's plot, on some rows of the samples: `x` and `y` (R,) in N·m.

    `joint` is the joint whose torque it is. For something unexplained x is its angle in rad,
    and `is_angle` is set.
    """

    finding: Finding
    joint: str
    x: FloatArray
    y: FloatArray
    is_angle: bool = False

    @property
    def share(self) -> float:
        """Return how much of the variance of y the line explains, 0 to 1."""
        total = float((self.y ** 2).sum())
        return 1.0 - float(((self.y - self.x) ** 2).sum()) / total if total > 0.0 else 0.0


def added_variable(motion: Motion, model: GravityModel, finding: Finding,
                   others: list[Finding], rows: IntArray) -> AddedVariable | None:
    """
    Return the added-variable plot of a finding; None where this motion cannot make one.

    :param motion: of all samples, as recorded.
    :param others: further findings, to be freed of.
    :param rows: which samples are wanted.
    """
    if finding.joint is not None and finding.joint not in model.joints:
        return None
    if finding.effect is None:
        joint = model.joints.index(finding.joint) if finding.joint else 0
        rest = _free(motion, model, joint, others, rows)[1]
        return AddedVariable(finding, model.joints[joint], motion.samples.q[rows, joint], rest,
                             True)
    columns = _columns(motion, model, finding.effect, finding.joint, finding.setting)
    if columns is None:
        return None
    joints = range(model.n_joints) if columns.ndim == 3 else [
        model.joints.index(finding.joint or model.joints[0])]
    best: AddedVariable | None = None
    gained = -1.0
    for joint in joints:
        own = (columns[:, joint] if columns.ndim == 3 else columns)[rows]
        basis, rest = _free(motion, model, joint, others, rows)
        own = own - basis @ (basis.T @ own)
        x = own @ lstsq(own, rest, rcond=1e-8)
        if float(x @ x) > gained:
            best, gained = AddedVariable(finding, model.joints[joint], x, rest), float(x @ x)
    return best


def _free(motion: Motion, model: GravityModel, joint: int, others: list[Finding],
          rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return an orthonormal basis (R, K) of what is known, and the torque without it (R,)."""
    samples = motion.samples
    features = model.torques[joint].indices
    tau = samples.tau[rows, joint]
    known = [np.zeros((len(rows), 0))]
    if len(features) <= min(_MOST_FEATURES, len(rows) // 4):
        known.append(dictionary.columns(samples.q[rows], features))
    else:
        tau = tau - motion.gravity[rows, joint]
    wanted: list[tuple[str, str | None, Setting]] = [
        (e.name, e.joint, e.setting) for e in model.applied.effects]
    wanted += [(f.effect, f.joint, f.setting) for f in others if f.effect is not None]
    for name, place, setting in wanted:
        columns = _columns(motion, model, name, place, setting)
        if columns is None or (columns.ndim == 2 and place != model.joints[joint]):
            continue
        known.append((columns[:, joint] if columns.ndim == 3 else columns)[rows])
    basis, spread, _ = svd(np.hstack(known))
    basis = basis[:, spread > 1e-9 * max(spread, default=0.0)]
    return basis, tau - basis @ (basis.T @ tau)


def _columns(motion: Motion, model: GravityModel, name: str, joint: str | None,
             setting: Setting) -> FloatArray | None:
    effect = all_effects().get(name)
    if effect is None:
        return None
    place = 0 if joint is None else model.joints.index(joint)
    try:
        return effect.columns(motion, place, setting)
    except (KeyError, ValueError, IndexError):
        return None
