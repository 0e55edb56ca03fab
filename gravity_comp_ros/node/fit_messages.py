"""
What the node asks the fit process, and what that answers.

This is all that either side knows of the other: the node's own process loads neither SciPy nor the
estimator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.model_acceptance import Verdict
from gravity_comp_ros.node.payload import PayloadFinding, PayloadLimits
from gravity_comp_ros.node.self_confirmation import Sent


@dataclass(frozen=True)
class Job:
    """
    What to fit: samples to learn from and to judge by.

    `base` is the model that was in use when the epoch began, to which a change may be fitted;
    `old` the one in use now, which is to be beaten. `effects` are to be in a whole model; `asked`
    says that somebody waits for it. `payload` bounds what a payload can be, `geometry` has the
    axes where they are known, `sent` the torque that the node published around each sample.
    `formulation` is that of a whole model, as in `FitOptions`.
    """

    number: int
    epoch: int
    train: JointSamples
    held: JointSamples
    base: GravityModel | None
    old: GravityModel | None
    formulation: str = 'auto'
    effects: tuple[str, ...] = ()
    asked: bool = False
    payload: PayloadLimits = PayloadLimits()
    geometry: Geometry | None = None
    sent: Sent | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """
    The best model of a job, how it fared against the one in use, and the time in s.

    `low` and `high` (N,) in rad are the range of the samples that it was learned from, and
    `outliers` counts the samples of each joint that were left out.
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
class Question:
    """Asks which effect is missing in `model`, going by these samples."""

    number: int
    samples: JointSamples
    model: GravityModel | None


@dataclass(frozen=True)
class Findings:
    """The answer to a question, in a line."""

    number: int
    text: str


@dataclass(frozen=True)
class Look:
    """Asks whether these samples show another payload than that of `model`; see `Job`."""

    number: int
    samples: JointSamples
    model: GravityModel
    payload: PayloadLimits = PayloadLimits()
    geometry: Geometry | None = None


@dataclass(frozen=True)
class Seen:
    """The answer to a look, and the stamp of its first sample in s."""

    number: int
    finding: PayloadFinding
    since: float
