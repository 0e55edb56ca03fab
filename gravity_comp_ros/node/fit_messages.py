"""
Jobs and results of the fit process.

These types are the only dependency of the node's process on the fit process: it imports neither
SciPy nor the estimator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.model_acceptance import Verdict
from gravity_comp_ros.node.payload import PayloadFinding, PayloadLimits
from gravity_comp_ros.node.self_confirmation import SentTorque


@dataclass(frozen=True)
class FitJob:
    """
    Fit a model to training samples, and compare it with the model in use on held-out samples.

    - `base`: model in use when the epoch began; its change may be fitted.
    - `old`: model in use now, to compare with.
    - `effects`: effects of a full fit; `on_request`: whether a service call requested the fit.
    - `payload`: limits of a payload; `geometry`: the axes where they are known.
    - `sent`: torque that the node published before each sample.
    - `formulation`: formulation of a full fit, as in `FitOptions`.
    """

    number: int
    epoch: int
    train: JointSamples
    held_out: JointSamples
    base: GravityModel | None
    old: GravityModel | None
    formulation: str = 'auto'
    effects: tuple[str, ...] = ()
    on_request: bool = False
    payload: PayloadLimits = PayloadLimits()
    geometry: Geometry | None = None
    sent: SentTorque | None = None


@dataclass(frozen=True, eq=False)
class FitResult:
    """
    The best model of a job, its verdict, and the computing time in s.

    `low` and `high` (N,) in rad are the range of the training samples. `outliers` has the number
    of samples of each joint that were left out.
    """

    number: int
    epoch: int
    model: GravityModel
    verdict: Verdict
    how: str
    seconds: float
    low: FloatArray
    high: FloatArray
    outliers: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class DiagnosisJob:
    """Find the effects that `model` does not include, in these samples."""

    number: int
    samples: JointSamples
    model: GravityModel | None


@dataclass(frozen=True)
class DiagnosisResult:
    """The findings of a diagnosis in one line."""

    number: int
    text: str


@dataclass(frozen=True)
class PayloadJob:
    """Test whether these samples show another payload than that of `model`; see `FitJob`."""

    number: int
    samples: JointSamples
    model: GravityModel
    payload: PayloadLimits = PayloadLimits()
    geometry: Geometry | None = None


@dataclass(frozen=True)
class PayloadResult:
    """The result of a payload test, and the stamp of its first sample in s."""

    number: int
    finding: PayloadFinding
    since: float
