"""What a refit with effects yields: a model, and how it fares on samples that it never saw."""

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

# The chance of an improvement by luck under which one is believed.
_BELIEVED = 0.05


@dataclass(frozen=True)
class HeldOut:
    """
    A joint's held-out RMSE in N·m without and with the new effects.

    `spread` is the range of its measured torque in N·m, 0 where it is constant.
    """

    before: float
    after: float
    spread: float

    @property
    def nrmse_before(self) -> float | None:
        """Return the error before as a share of the torque's range (Yu 2022, Eq. 16)."""
        return self.before / self.spread if self.spread > 0.0 else None

    @property
    def nrmse_after(self) -> float | None:
        """Return the error after as a share of the torque's range (Yu 2022, Eq. 16)."""
        return self.after / self.spread if self.spread > 0.0 else None


@dataclass(frozen=True)
class Refit:
    """
    A model with effects, and how it fared on held-out samples.

    `added` are targets; `errors` the held-out errors by joint; `p` is the chance of so much
    improvement (or more) if there is none. `n_samples` were fitted, fast ones too if
    `all_speeds`. `skipped` tells which effects were left out and why, `implausible` which are
    in the model with values that physics does not allow, and `kept` which old ones this
    recording does not show, so that they stay as they were.
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
        """Return what a user should think twice about."""
        lines = [f'{name} is not physical: {why}' for name, why in self.implausible.items()]
        if not self.helps:
            lines.append('the held-out error does not fall by more than chance: these recordings '
                         'do not need what was added, or gravity imitated it already')
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
        """Return whether the held-out error falls by more than chance would have it."""
        return self.p < _BELIEVED


def held_out(work: RefitProblem, before: FloatArray, after: FloatArray) -> dict[str, HeldOut]:
    """Return the errors by joint of held-out residuals (R, N)."""
    spread = np.ptp(work.motion.samples.tau[work.rows], axis=0)
    rmse = [np.sqrt((rest ** 2).mean(axis=0)) for rest in (before, after)]
    return {name: HeldOut(float(rmse[0][n]), float(rmse[1][n]), float(spread[n]))
            for n, name in enumerate(work.model.joints)}


def chance(work: RefitProblem, blocks: Blocks, before: FloatArray, after: FloatArray) -> float:
    """
    Return the p-value of the fall of the error, block by block.

    Of the whole arm or of one joint, the smaller, corrected for having looked at both and at all
    joints (Bonferroni): an effect of one joint must not be judged by the noise of the others.
    """
    old, new = (blocks.sums((rest / work.sigma) ** 2) for rest in (before, after))
    whole = gain(old.sum(axis=1, keepdims=True), new.sum(axis=1, keepdims=True), 2).p
    joints = old.shape[1]
    return min(whole, *(gain(old[:, [n]], new[:, [n]], 2 * joints).p for n in range(joints)))
