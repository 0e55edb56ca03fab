"""
Gains of the joints' efforts that contradict one arm: other units, rated torques, gear ratios.

The torques of all joints come from the same moments, seen through the axes (`ArmFit`). The
differences of the logarithms of the gains are identified where two joints carry the same link at
several poses; their common part is a unit of the moments. A joint without gravity of its own, such
as the first of a level arm, has no identified gain. The search has several gains at the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.arm_fit import ArmFit, cost_of, WIDTHS
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


@dataclass(frozen=True)
class GainOptions:
    """
    Limits of gains that disagree.

    - `min_ratio`: smaller differences are the effect `torque_gain`; other units and ratings differ
      by more.
    - `sigmas`: standard deviations by which the logarithm of a gain differs from 0.
    - `max_residual`: share of a joint's effort (without friction) that an arm with these gains
      may leave, and `max_reference` of the joint with the largest effort; more is another effect.
    - `max_time`: correlation time of the residuals, in rows of some tenths of a second; that of
      an arm with wrong gains, or of a base that moved, is that of the motion.
    - `min_gain`: log evidence in nats, over the autocorrelation time, of gains that differ.
    - `starts`: gains at the start of the search: equal ones, then drawn ones, whose logarithms
      have the standard deviation `spread`.

    :raises OptionError: if a value is not positive.
    """

    min_ratio: float = 1.5
    sigmas: float = 4.0
    max_residual: float = 0.3
    max_reference: float = 0.1
    max_time: float = 10.0
    min_gain: float = 10.0
    starts: int = 4
    spread: float = 1.2

    def __post_init__(self) -> None:
        check_positive(self, 'gains')


@dataclass(frozen=True)
class JointGains:
    """
    Gains relative to the joint `reference`.

    `log` and `std` (N,) are the logarithm and its standard deviation, `residual` (N,) the share of
    a joint's effort that remains, `time` its correlation time in rows, `evidence` in nats that of
    gains that differ.
    """

    names: tuple[str, ...]
    reference: int
    log: FloatArray
    std: FloatArray
    residual: FloatArray
    time: float
    evidence: float

    def relative_to(self, model: GravityModel, samples: JointSamples) -> JointGains:
        """Return the gains relative to the joint whose effort is most like that of a model."""
        gravity, change = model.predict(samples.q), np.full(len(self.names), np.inf)
        for n in np.flatnonzero(self.std < np.log(GainOptions().min_ratio)):
            columns = np.column_stack([gravity[:, n], np.ones(len(gravity)), samples.qd[:, n],
                                       np.tanh(samples.qd[:, n] / WIDTHS[1])])
            gain = float(np.linalg.lstsq(columns, samples.tau[:, n], rcond=None)[0][0])
            change[n] = abs(np.log(max(gain, 1e-9)))
        best = int(np.argmin(change))
        std = np.hypot(self.std, self.std[best])
        std[best] = 0.0
        return replace(self, reference=best, log=self.log - self.log[best], std=std)

    def facts(self, options: GainOptions = GainOptions()) -> list[Fact]:
        """Return the fact that gains disagree, if they do."""
        if self.evidence < options.min_gain or self.time > options.max_time:
            return []
        clear = ((np.abs(self.log) > np.log(options.min_ratio))
                 & (np.abs(self.log) > options.sigmas * self.std)
                 & (self.residual < options.max_residual))
        if not clear.any() or self.residual[self.reference] > options.max_reference:
            return []
        joints = [int(n) for n in np.flatnonzero(clear)]
        parts = [f'{self.names[n]} {self._ratio(n)}' for n in joints]
        ratios = {self.names[n]: float(np.exp(self.log[n])) for n in joints}
        scales = ','.join(f'{name}={1.0 / ratio:.3g}' for name, ratio in ratios.items())
        agree = [name for n, name in enumerate(self.names) if n != self.reference
                 and n not in joints and options.sigmas * self.std[n] < np.log(options.min_ratio)]
        also = f'; in agreement: {", ".join(agree)}' if agree else ''
        return [Fact(
            Kind.EFFORT_GAIN, tuple(ratios), f'gains disagree: effort in multiples of what '
            f'{self.names[self.reference]} implies by the links that both carry is '
            f'{", ".join(parts)}{also}', Action.NOTED, 'no arm has such torques: units, rated '
            'torques, gear ratios or torque constants differ',
            f'--effort-scale {scales} gives them the unit of {self.names[self.reference]}',
            ratios)]

    def _ratio(self, n: int) -> str:
        low, ratio, high = np.exp(self.log[n] + self.std[n] * np.array([-1.96, 0.0, 1.96]))
        return f'{ratio:.3g} (95 %: {low:.3g} to {high:.3g})'


def joint_gains(fit: ArmFit, options: GainOptions = GainOptions()) -> JointGains:
    """Return the gains of a recording."""
    n = fit.q.shape[1]
    reference = int(np.argmax(fit.size))
    free = np.array([k for k in range(n) if k != reference and fit.size[k] > 0])
    equal, rng = fit.plain, np.random.default_rng(0)
    fits = [fit.run(equal.chain, free=free)]
    for each in fit.plains:
        # The chain may be that of one joint, to which the gains of the others are relative.
        log = np.zeros(n)
        gains = fit.gains(each.chain)
        log[free] = np.log(gains[free] / gains[reference])
        moments = each.chain.moments * gains[reference]
        fits.append(fit.run(replace(each.chain, moments=moments), log, free))
    best = min(fits, key=cost_of)
    time = fit.time(best)
    if time > options.max_time or equal.cost - best.cost > options.min_gain * time:
        for seed in range(1, options.starts):
            log = np.zeros(n)
            log[free] = rng.normal(0.0, options.spread, len(free))
            fits.append(fit.run(fit.start(seed, log), log, free))
    best = min(fits, key=cost_of)
    time, std = fit.time(best), np.zeros(n)
    std[free] = fit.std(best, free)
    return JointGains(fit.poses.names, reference, best.log, std, fit.rest(best), time,
                      (equal.cost - best.cost) / time)
