"""Thresholds of a diagnosis, and their justification."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.errors import OptionError

# Minimum share of an effect's torque that gravity does not absorb; below it the size is uncertain.
MIN_UNABSORBED = 0.03


@dataclass(frozen=True)
class SelectionOptions:
    """
    Thresholds for the selection of an effect.

    - `alpha`: family-wise error rate.
    - `min_share`: minimum reduction of a joint's held-out error; `min_rare_share`: the same for a
      rare effect. A rare effect of the whole arm must reach it on a joint where
      gravity does not absorb a share of at least `min_unabsorbed_nuisance` of offset and spring.
    - `evident_share`: Coulomb or viscous friction or an offset with this reduction of the error
      is not corrected for the other joints and effects tested, and a t-test of its coefficient is
      accepted as well. Chance reduces the error by a few percent, and a short recording has few
      blocks. `evident_rare_share`: reduction from which other effects can use that t-test.
    - `max_effects`: maximum number of effects.

    :raises OptionError: if a value is out of range.
    """

    alpha: float = 0.01
    min_share: float = 0.004
    min_rare_share: float = 0.1
    min_unabsorbed_nuisance: float = MIN_UNABSORBED
    evident_share: float = 0.4
    evident_rare_share: float = 0.8
    max_effects: int = 40

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha < 1.0 or self.max_effects < 1:
            raise OptionError('selection: alpha lies in (0, 1), max_effects is at least 1')
        if not (0.0 <= self.min_share < 1.0 and 0.0 <= self.min_rare_share < 1.0):
            raise OptionError('selection: min_share and min_rare_share lie in [0, 1)')
        if not (0.0 < self.evident_share <= 1.0 and 0.0 < self.evident_rare_share <= 1.0):
            raise OptionError('selection: evident_share and evident_rare_share lie in (0, 1]')


@dataclass(frozen=True)
class VerdictOptions:
    """
    Thresholds for the verdict on a chosen effect.

    - `min_effective`: minimum effective sample size of a finding.
    - `min_effective_established`: the same for *established*; the jackknife of an interval needs
      about 20 groups. `effective_per_coefficient` is added for each further coefficient (Harrell,
      Regression Modeling Strategies, 2015, 4.4).
    - `max_coefficients`: an effect with more coefficients needs that sample size for any finding,
      as does a rare effect with more than `max_rare_coefficients`, which can be a substitute for
      common effects. A reduction of the squared error by `evident_reduction` is an exception. It
      is also required of an effect whose coefficients are significant only together.
    - `min_reduction`: minimum relative reduction of the RMSE of the most affected joint.
    - `min_runs_better`: minimum share of runs that an *established* effect improves.
    - `max_collinearity`: two effects are indistinguishable if one explains more than this share
      of the squared columns of the other.
    - `min_unabsorbed`: if gravity absorbs all but this share of an effect's torque, errors of the
      gravity model determine its size. Over 0.7 rad a sine and an offset explain all but 1 % of
      a spring; of offsets with less than 2.6 % one in five was wrong by half or more.
    - `min_torque_ratio`: the law of an effect is accurate to some percent. A rare effect with less
      than this share of another effect's torque may be its model error; if both are rare and
      confounders (an end stop and a cable), less than `min_confounder_ratio`.

    :raises OptionError: if a value is out of range.
    """

    min_effective: float = 8.0
    min_effective_established: float = 20.0
    effective_per_coefficient: float = 10.0
    max_coefficients: int = 8
    max_rare_coefficients: int = 2
    evident_reduction: float = 0.8
    min_reduction: float = 0.01
    min_runs_better: float = 0.8
    max_collinearity: float = 0.95
    min_unabsorbed: float = MIN_UNABSORBED
    min_torque_ratio: float = 0.03
    min_confounder_ratio: float = 0.2

    def __post_init__(self) -> None:
        if min(self.min_effective, self.min_effective_established,
               self.effective_per_coefficient) < 0.0:
            raise OptionError('verdict: numbers of samples are at least 0')
        for name in ('evident_reduction', 'min_reduction', 'min_runs_better', 'max_collinearity',
                     'min_unabsorbed', 'min_torque_ratio', 'min_confounder_ratio'):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise OptionError(f'verdict: {name} is {getattr(self, name)}; it is a share, '
                                  f'from 0 to 1')


@dataclass(frozen=True)
class DiagnosisOptions:
    """Options of a diagnosis; `effects` are the effects to test (None: all)."""

    selection: SelectionOptions = SelectionOptions()
    verdict: VerdictOptions = VerdictOptions()
    effects: tuple[str, ...] | None = None
