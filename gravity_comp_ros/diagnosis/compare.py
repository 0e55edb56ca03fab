"""Compare a model with measurements, joint by joint, and say where it fails."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.diagnosis.where import find_places, Place
from gravity_comp_ros.effects.predict import predict_torque, rows_of
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.gravity.model import GravityModel
from gravity_comp_ros.samples import BoolArray, FloatArray, JointSamples
import numpy as np


@dataclass(frozen=True)
class JointComparison:
    """
    One joint's residual, measured minus predicted torque, over `n` samples.

    `rmse`, `bias` (mean), `std` and `max_abs` are in N·m; rmse^2 = bias^2 + std^2. `nrmse` is
    the RMSE as a fraction of the range of the measured torque (Yu 2022, Eq. 16), None where
    that range is 0. `rmse_constant` is what predicting the mean measured torque would leave.
    """

    n: int
    rmse: float
    nrmse: float | None
    std: float
    bias: float
    max_abs: float
    rmse_constant: float
    where: tuple[Place, ...]


@dataclass(frozen=True)
class Comparison:
    """The comparison of every joint; `residual` (M, N) in N·m, `outside` (M,) poses."""

    joints: dict[str, JointComparison]
    residual: FloatArray
    share_outside: float

    @property
    def worst(self) -> str:
        """Return the joint with the largest RMSE."""
        return max(self.joints, key=lambda name: self.joints[name].rmse)

    def to_json(self) -> dict[str, Any]:
        """Return what `compare --json` prints."""
        return {'joints': {name: asdict(joint) for name, joint in self.joints.items()},
                'worst_joint': self.worst, 'share_outside_trained_range': self.share_outside}


def compare(model: GravityModel, samples: JointSamples,
            recorded: JointSamples | None = None) -> Comparison:
    """
    Compare `model`, with the effects that it has, with measured torques.

    Joints are matched by name.

    :param recorded: what `samples` were selected from; the model's effects may need what lies
        between (acceleration, friction that builds up).
    :raises ModelMismatchError: if the samples lack a joint of the model, or the model has an
        effect that is not installed here.
    :raises DataError: if there are no samples.
    """
    samples = samples.joints(model.joints)
    if recorded is None or not model.applied.effects:
        predicted = predict_torque(model, samples)
    else:
        predicted = predict_torque(model, recorded)[rows_of(recorded, samples)]
    return compare_prediction(samples, predicted,
                              model.coverage.distance(samples.q).max(axis=1) > 0.0)


def compare_prediction(samples: JointSamples, predicted: FloatArray,
                       outside: BoolArray) -> Comparison:
    """
    Compare predicted torques (M, N) with the samples' measured ones.

    :param outside: which poses (M,) lie outside the trained range.
    :raises DataError: if there are no samples.
    """
    if not samples.n_samples:
        raise DataError('no samples to compare with; none passed the gate, or the bag is empty')
    residual = samples.tau - predicted
    joints = {}
    for n, name in enumerate(samples.names):
        r, tau = residual[:, n], samples.tau[:, n]
        rmse, spread = float(np.sqrt((r ** 2).mean())), float(np.ptp(tau))
        joints[name] = JointComparison(
            n=len(r), rmse=rmse, nrmse=rmse / spread if spread > 0.0 else None,
            std=float(r.std()), bias=float(r.mean()), max_abs=float(np.abs(r).max()),
            rmse_constant=float(tau.std()),
            where=tuple(find_places(samples, predicted, outside, n)))
    return Comparison(joints, residual, float(np.mean(outside)))
