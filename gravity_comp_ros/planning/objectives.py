"""
Design objectives of a motion: an effect against its alternatives, or the gravity uncertainty.

An objective reduces a motion to an information matrix. Those of several motions add.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.context import DesignContext, DesignProblem, n_columns
from gravity_comp_ros.planning.criterion import effect_score, EffectScore
from gravity_comp_ros.planning.gravity_uncertainty import GravityScore, GravityUncertainty
import numpy as np

_GATE = GateOptions()


@dataclass(frozen=True, eq=False)
class EffectObjective:
    """Separation of an effect; of an `auxiliary` one the recordings do not count."""

    problem: DesignProblem
    context: DesignContext
    auxiliary: bool = False

    @property
    def uses_gradient(self) -> bool:
        """Return whether the regressors contain the gradient of gravity by the angles."""
        return len(self.problem.joints) > 1

    @property
    def joint(self) -> int | None:
        """Return the joint that has to move; None if any joint serves."""
        return self.problem.joints[0] if len(self.problem.joints) == 1 else None

    @cached_property
    def _prior(self) -> FloatArray:
        return self.context.prior(self.problem)

    @cached_property
    def _widths(self) -> tuple[int, ...]:
        return tuple(n_columns(one, self.context.recorded)
                     for one in (self.problem.target, *self.problem.alternatives))

    def recorded_information(self) -> FloatArray:
        """Return the information matrix of the recordings."""
        information = self.context.information(self.problem, self.context.recorded,
                                               self.context.seconds_per_row)
        return 0.0 * information if self.auxiliary else information

    def planned_information(self, motion: Motion) -> FloatArray:
        """Return the information matrix of a planned motion."""
        context = self.context
        return context.information(self.problem, motion, 1.0 / context.rate, context.n_prefix)

    def score(self, information: FloatArray) -> EffectScore:
        """Return the score of an information matrix."""
        # Absorption by gravity is not considered for effects of the whole arm.
        n_gravity = self.context.n_gravity if len(self.problem.joints) == 1 else 0
        return effect_score(information, self._prior, self._widths, self.problem.size, n_gravity,
                            self.context.gravity_factor)

    def untestable(self, both: Motion) -> str | None:
        """Return why a diagnosis of recordings and motion cannot test it, None if it can."""
        target = self.problem.target
        return target.effect.untestable(both, target.joint or 0)


@dataclass(frozen=True, eq=False)
class GravityObjective:
    """
    Standard deviation of the gravity torque over the recorded poses.

    The model's covariance already contains the information of its own recordings.
    """

    uncertainty: GravityUncertainty
    context: DesignContext
    uses_gradient: bool = False
    joint: int | None = None

    def recorded_information(self) -> FloatArray:
        return self.uncertainty.zero_information()

    def planned_information(self, motion: Motion) -> FloatArray:
        context = self.context
        # A gravity fit uses slow samples only, thinned to the rate of the gate.
        slow = np.flatnonzero((np.abs(motion.samples.qd) < _GATE.max_speed).all(axis=1))
        slow = slow[slow >= context.n_prefix]
        kept = min(1.0, (_GATE.rate_hz or np.inf) * context.step)
        weights = context.information_rate * kept / context.rate
        return self.uncertainty.information(motion.samples.q[slow],
                                            context.nuisance_columns(motion)[slow], weights)

    def score(self, information: FloatArray) -> GravityScore:
        return self.uncertainty.score(information)

    def untestable(self, both: Motion) -> str | None:
        return None


Objective = EffectObjective | GravityObjective
Score = EffectScore | GravityScore
