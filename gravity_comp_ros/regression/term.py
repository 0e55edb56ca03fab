"""A term: the columns of one effect at one setting, on one joint or shared by all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.effects.effect import Effect
import numpy as np
from scipy.special import log_ndtr

Key = tuple[str, int | None]


@dataclass(frozen=True, eq=False)
class Term:
    """
    One effect with its nonlinear `setting`.

    `joint` is its number, None for the whole arm. `columns` are the means over rows, (R, K) on
    that joint or (R, N, K) on all; `prior_std` (K,) the prior standard deviations of the
    coefficients; `log_odds` the prior log odds, divided among the settings that are compared.
    `log_volume` is the logarithm of the share of its cell of settings in which a refined setting
    lies (`refinement.log_volume`), 0 for one that is not refined.
    """

    effect: Effect
    joint: int | None
    setting: Mapping[str, float]
    columns: FloatArray
    prior_std: FloatArray
    log_odds: float
    log_volume: float = 0.0

    @property
    def log_prior(self) -> float:
        """Return the prior log odds of the term at its setting."""
        return self.log_odds + self.log_volume

    @property
    def name(self) -> str:
        return self.effect.name

    @cached_property
    def key(self) -> Key:
        """Return the name and the joint, which a model has once."""
        return self.effect.name, self.joint

    @cached_property
    def kind(self) -> tuple[object, ...]:
        """Return the key and the discrete parameters: each kind is refined for itself."""
        return self.key, *(self.setting.get(name) for name in self.effect.discrete)

    @cached_property
    def positive(self) -> BoolArray:
        """Return a mask (K,) of the coefficients that cannot be negative."""
        return self.effect.positive(self.setting, self.n_columns)

    def log_share_allowed(self, mean: FloatArray, std: FloatArray) -> FloatArray:
        """
        Return the log evidence (...) that a prior of positive coefficients adds; 0 without one.

        The prior is a normal distribution cut at 0, so the factor is the posterior probability of
        the allowed side over the prior's, 1/2, for each coefficient.

        :param mean: of the coefficients (..., K), with their standard deviations `std` (..., K).
        """
        here = self.positive
        ratio = mean[..., here] / np.maximum(std[..., here], 1e-300)
        return np.asarray((log_ndtr(ratio) + np.log(2.0)).sum(axis=-1))

    @property
    def n_columns(self) -> int:
        return self.columns.shape[-1]

    @property
    def joint_number(self) -> int:
        """Return the joint number for methods of the effect: 0 for the whole arm."""
        return 0 if self.joint is None else self.joint

    @property
    def holds_a_joint(self) -> bool:
        """Return whether it acts at rest, on one joint."""
        return self.effect.is_static and self.columns.ndim == 2

    def joints(self, n_joints: int) -> range:
        """Return the joints on whose torque it acts."""
        if self.columns.ndim == 3:
            return range(n_joints)
        return range(self.joint_number, self.joint_number + 1)

    def on(self, joint: int) -> FloatArray:
        """Return the columns on the torque of one joint, (R, K)."""
        return self.columns[:, joint] if self.columns.ndim == 3 else self.columns

    @cached_property
    def common(self) -> dict[str, float]:
        """Return the nonlinear parameters that it has in common with others of its joint."""
        return {name: self.setting[name] for name in self.effect.common if name in self.setting}

    @cached_property
    def parents(self) -> frozenset[Key]:
        """Return the terms of which one must be in the model; empty if it needs none."""
        return frozenset((name, self.joint) for name in self.effect.corrects)


def is_consistent(terms: tuple[Term, ...]) -> bool:
    """Return whether every correction has an effect that it corrects."""
    keys = {term.key for term in terms}
    return all(not term.parents or term.parents & keys for term in terms)


def with_children_of(terms: tuple[Term, ...], dropped: Term) -> tuple[Term, ...]:
    """Return the terms without one, and without the corrections that only it allows."""
    rest = tuple(term for term in terms if term is not dropped)
    while not is_consistent(rest):
        keys = {term.key for term in rest}
        rest = tuple(term for term in rest if not term.parents or term.parents & keys)
    return rest


def uncorrected(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """
    Return the terms that may be removed alone, because no correction depends on them.

    A correction is nearly collinear with what it corrects. So it is judged first: the gain of the
    other is small as long as both are there.
    """
    return tuple(term for term in terms if len(with_children_of(terms, term)) == len(terms) - 1)


def total_std(terms: Sequence[Term]) -> FloatArray:
    """Return the prior standard deviations of all coefficients."""
    return np.concatenate([np.zeros(0), *(term.prior_std for term in terms)])
