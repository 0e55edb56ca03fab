"""The thresholds of a diagnosis, each with what it is derived from."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.errors import OptionError

# Where gravity imitates all but this share of the torque of an effect, the size is uncertain.
MIN_UNABSORBED = 0.03


@dataclass(frozen=True)
class SelectionOptions:
    """
    When an effect counts.

    `alpha` is the family-wise chance of a false alarm; `least_share` of a joint's held-out
    error must go for an effect to be worth a name, `least_rare_share` for one that is not
    expected in every joint; `most` effects are looked for in all. Something rare that acts on the
    whole arm takes that share off another joint than one whose offset or spring the motion hides,
    since gravity imitates all but `least_shown` of it. Friction or an
    offset that takes `evident_share` off a joint's error is not corrected for the other joints and
    effects that were tried, and may be proven by its size as well: chance takes a few hundredths
    off, and a short recording has few blocks. So may what else takes `evident_rare_share` off.

    :raises OptionError: if a value is out of range.
    """

    alpha: float = 0.01
    least_share: float = 0.004
    least_rare_share: float = 0.1
    least_shown: float = MIN_UNABSORBED
    evident_share: float = 0.4
    evident_rare_share: float = 0.8
    most: int = 40

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha < 1.0 or self.most < 1:
            raise OptionError('selection: alpha lies in (0, 1), most is at least 1')
        if not (0.0 <= self.least_share < 1.0 and 0.0 <= self.least_rare_share < 1.0):
            raise OptionError('selection: least_share and least_rare_share lie in [0, 1)')
        if not (0.0 < self.evident_share <= 1.0 and 0.0 < self.evident_rare_share <= 1.0):
            raise OptionError('selection: evident_share and evident_rare_share lie in (0, 1]')


@dataclass(frozen=True)
class VerdictOptions:
    """
    What a verdict asks of a chosen effect.

    `fewest_effective`: with fewer samples that count as independent nothing is a finding, and
    with fewer than `least_effective` nothing is *established*: the jackknife of an interval needs
    about 20 groups. `effective_each`: *established* asks for this many more a coefficient, as a
    rule of thumb of regression has it (Harrell, Regression Modeling Strategies, 2015, 4.4); of an
    effect with more than `many` coefficients any finding does, of a rare one, which could stand
    for something common, with more than `many_rare`; but for one that takes `evident_of_many` off
    the squared error, which no chance among so many coefficients does.
    `least_reduction`: an effect that takes a smaller share off the RMSE of the joint where it
    helps most is not worth a name. `most_runs`: *established* asks for a gain in this share of
    the runs. `alike`: two effects whose columns agree to this share of their squares cannot be
    told from each other. `least_left`: where gravity imitates all but this share of the torque of
    an effect, what gravity lacks makes its size: over 0.7 rad a sine and an offset leave 1 % of a
    spring, and of offsets with less than 2.6 % one in five was wrong by half or more.
    `least_part`: the law of an effect is right to some percent, so that something rare with less
    than this share of another's torque may be what that law leaves, and with less than
    `least_of_confounder` if it is rare as well and the two are easily confused: a stop beside a
    cable.

    :raises OptionError: if a value is out of range.
    """

    fewest_effective: float = 8.0
    least_effective: float = 20.0
    effective_each: float = 10.0
    many: int = 8
    many_rare: int = 2
    evident_of_many: float = 0.8
    least_reduction: float = 0.01
    most_runs: float = 0.8
    alike: float = 0.95
    least_left: float = MIN_UNABSORBED
    least_part: float = 0.03
    least_of_confounder: float = 0.2

    def __post_init__(self) -> None:
        if min(self.fewest_effective, self.least_effective, self.effective_each) < 0.0:
            raise OptionError('verdict: numbers of samples are at least 0')
        for name in ('evident_of_many', 'least_reduction', 'most_runs', 'alike', 'least_left',
                     'least_part', 'least_of_confounder'):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise OptionError(f'verdict: {name} is {getattr(self, name)}; it is a share, '
                                  f'from 0 to 1')


@dataclass(frozen=True)
class DiagnosisOptions:
    """How to diagnose, and which effects to look for (None: all)."""

    selection: SelectionOptions = SelectionOptions()
    verdict: VerdictOptions = VerdictOptions()
    effects: tuple[str, ...] | None = None
