"""Result of a refit with effects: the model, and held-out errors before and after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.refit_terms import RefitProblem
from gravity_comp_ros.evaluation.blocks import Blocks
from gravity_comp_ros.evaluation.gain import gain
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Maximum p-value of a significant decrease of the held-out error.
_MAX_P = 0.05


@dataclass(frozen=True)
class HeldOut:
    """
    A joint's held-out RMSE in N·m without and with the new effects.

    `torque_range` is the range of its measured torque in N·m, 0 if it is constant.
    """

    before: float
    after: float
    torque_range: float

    @property
    def nrmse_before(self) -> float | None:
        """Return the error before as a share of the torque's range (Yu 2022, Eq. 16)."""
        return self.before / self.torque_range if self.torque_range > 0.0 else None

    @property
    def nrmse_after(self) -> float | None:
        """Return the error after as a share of the torque's range (Yu 2022, Eq. 16)."""
        return self.after / self.torque_range if self.torque_range > 0.0 else None


@dataclass(frozen=True)
class Refit:
    """
    A model with effects, and its errors on held-out samples.

    `added` are targets; `errors` the held-out errors by joint; `p` is the p-value of their
    decrease. `n_samples` were fitted, fast ones too if `all_speeds`. `skipped` are omitted
    effects with the reason, `implausible` those in the model with coefficients that are not
    physical, and `kept` old ones that this recording does not excite, with unchanged
    coefficients.
    """

    model: GravityModel
    added: tuple[str, ...]
    errors: Mapping[str, HeldOut]
    p: float
    n_samples: int
    all_speeds: bool
    skipped: Mapping[str, str]
    implausible: Mapping[str, str]
    kept: tuple[str, ...]

    def warnings(self) -> list[str]:
        """Return warnings about the new effects."""
        lines = [f'{name} is not physical: {why}' for name, why in self.implausible.items()]
        if not self.helps:
            lines.append('the held-out error does not decrease significantly: these recordings '
                         'do not require the new effects, or gravity has absorbed them already')
        return lines

    def by_joint(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return held-out RMSE in N·m by joint, before and after."""
        return ({name: e.before for name, e in self.errors.items()},
                {name: e.after for name, e in self.errors.items()})

    def to_json(self) -> dict[str, Any]:
        """Return the refit as `add --json` prints it; errors in N·m, shares of the range."""
        return {
            'added': list(self.added),
            'held_out': {name: {'rmse_before': e.before, 'rmse_after': e.after,
                                'nrmse_before': e.nrmse_before, 'nrmse_after': e.nrmse_after}
                         for name, e in self.errors.items()},
            'effects': [{'target': e.target, **asdict(e)} for e in self.model.applied.effects],
            'p': self.p, 'n_samples': self.n_samples, 'all_speeds': self.all_speeds,
            'left_out': dict(self.skipped), 'implausible': dict(self.implausible),
            'kept': list(self.kept)}

    @property
    def helps(self) -> bool:
        """Return whether the held-out error decreases significantly."""
        return self.p < _MAX_P


def held_out_errors(work: RefitProblem, before: FloatArray,
                    after: FloatArray) -> dict[str, HeldOut]:
    """Return the errors by joint of held-out residuals (R, N) in N·m."""
    torque_range = np.ptp(work.motion.samples.tau[work.rows], axis=0)
    rmse = [np.sqrt((residual ** 2).mean(axis=0)) for residual in (before, after)]
    return {name: HeldOut(float(rmse[0][n]), float(rmse[1][n]), float(torque_range[n]))
            for n, name in enumerate(work.model.joints)}


def p_value(work: RefitProblem, blocks: Blocks, before: FloatArray, after: FloatArray) -> float:
    """
    Return the p-value of the decrease of the error, over blocks.

    The smaller one of the whole arm and of single joints, with a Bonferroni correction for both
    and for all joints: the noise of other joints would hide an effect on one joint.
    """
    old, new = (blocks.sums((residual / work.sigma) ** 2) for residual in (before, after))
    whole = gain(old.sum(axis=1, keepdims=True), new.sum(axis=1, keepdims=True), 2).p
    joints = old.shape[1]
    return min(whole, *(gain(old[:, [n]], new[:, [n]], 2 * joints).p for n in range(joints)))
