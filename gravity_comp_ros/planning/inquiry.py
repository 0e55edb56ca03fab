"""
What a motion is asked about: an effect beside its alternatives, or gravity where it is unsure.

Each inquiry keeps of a motion its information matrix; those of several motions add.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.criterion import Answer, answer
from gravity_comp_ros.planning.gravity_doubt import GravityAnswer, GravityDoubt
from gravity_comp_ros.planning.regressors import Question, Situation, width
import numpy as np

_GATE = GateOptions()


class Valued(Protocol):
    """What an information matrix says."""

    @property
    def value(self) -> float:
        """Return what the choice of a motion maximises."""


class Inquiry(Protocol):
    """Something that a motion is to tell."""

    @property
    def uses_gradient(self) -> bool:
        """Return whether it asks how gravity changes with the angles."""

    @property
    def joint(self) -> int | None:
        """Return the joint that has to move; None if any may."""

    def recorded(self) -> FloatArray:
        """Return the information that the recordings have."""

    def planned(self, motion: Motion) -> FloatArray:
        """Return the information of a planned motion."""

    def answer(self, information: FloatArray) -> Valued:
        """Return what information says."""

    def untestable(self, both: Motion) -> str | None:
        """Return why a diagnosis of recordings and motion will not look for it, if it will not."""


@dataclass(frozen=True, eq=False)
class EffectInquiry:
    """An effect; of a `companion` the new motion has to tell by itself."""

    question: Question
    situation: Situation
    companion: bool = False

    @property
    def uses_gradient(self) -> bool:
        return len(self.question.joints) > 1

    @property
    def joint(self) -> int | None:
        return self.question.joints[0] if len(self.question.joints) == 1 else None

    @cached_property
    def _prior(self) -> FloatArray:
        return self.situation.prior(self.question)

    @cached_property
    def _widths(self) -> tuple[int, ...]:
        return tuple(width(one, self.situation.recorded)
                     for one in (self.question.target, *self.question.alternatives))

    def recorded(self) -> FloatArray:
        found = self.situation.information(self.question, self.situation.recorded,
                                           self.situation.seconds_a_row)
        return 0.0 * found if self.companion else found

    def planned(self, motion: Motion) -> FloatArray:
        return self.situation.planned_information(self.question, motion)

    def answer(self, information: FloatArray) -> Answer:
        # What gravity imitates of an effect of the arm is not asked.
        n_gravity = self.situation.n_gravity if len(self.question.joints) == 1 else 0
        return answer(information, self._prior, self._widths, self.question.size, n_gravity,
                      self.situation.imitation)

    def untestable(self, both: Motion) -> str | None:
        target = self.question.target
        return target.effect.untestable(both, target.joint or 0)


@dataclass(frozen=True, eq=False)
class GravityInquiry:
    """
    The torque that the model predicts over the recorded poses.

    The uncertainty of the model has what its own recordings told.
    """

    doubt: GravityDoubt
    situation: Situation
    uses_gradient: bool = False
    joint: int | None = None

    def recorded(self) -> FloatArray:
        return self.doubt.nothing()

    def planned(self, motion: Motion) -> FloatArray:
        own, situation = self.situation.own_columns(motion), self.situation
        # A fit of gravity takes slow samples only, and few of them a second.
        slow = np.flatnonzero((np.abs(motion.samples.qd) < _GATE.max_speed).all(axis=1))
        slow = slow[slow >= situation.skip]
        kept = min(1.0, (_GATE.rate_hz or np.inf) * situation.step)
        weights = situation.noise.per_second * kept / situation.rate
        return self.doubt.information(motion.samples.q[slow], own[slow], weights)

    def answer(self, information: FloatArray) -> GravityAnswer:
        return self.doubt.answer(information)

    def untestable(self, both: Motion) -> str | None:
        return None
