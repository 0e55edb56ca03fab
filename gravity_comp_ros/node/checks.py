"""Checks of a decision: names, statistic and limit of each, and the limits of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import json
import math

from gravity_comp_ros.data.option_checks import check_positive

# Names of the checks, as on `~/checks`; docs/node.md explains each.
BETTER, NO_JOINT_WORSE = 'better on held-out samples', 'no joint worse'
POSE_EXPLAINS, GRAVITY_PRESENT = 'pose explains the effort', 'gravity is present'
NOT_OUTPUT, CONVERGED = 'not the output of the node', 'converged'
JOINTS_AGREE, BODY_EXPLAINS = 'joints agree', 'a body explains the change'
NO_FAULT, WITHIN_LIMITS = 'no fault explains it better', 'within the payload limits'
BODY_PRESENT, IN_EACH_PART = 'a body is present', 'in each part of the window'
NO_PUSH, NOT_VARYING = 'no push in another direction', 'no varying force'
NO_FACT = 'no fact against the samples'
LASTS = 'lasts long enough'
PREDICTS, BETTER_THAN_PREVIOUS = 'predicts new samples', 'better than the previous model'


@dataclass(frozen=True)
class Check:
    """
    One check: its name, the statistic, the limit, and whether it passed; `text` names the reason.

    A statistic passes if it is at most the limit, or at least the limit with `is_minimum`.
    """

    name: str
    statistic: float
    limit: float
    is_minimum: bool = False
    text: str = ''

    @property
    def passed(self) -> bool:
        if self.is_minimum:
            return bool(self.statistic >= self.limit)
        return bool(self.statistic <= self.limit)

    def describe(self) -> str:
        """Return the check with its figures as text."""
        sign = '≥' if self.is_minimum else '≤'
        figures = f'{self.name}: {self.statistic:.3g} {sign} {self.limit:.3g}'
        return figures if self.passed else f'not {figures}'


def failed(checks: Sequence[Check]) -> Check | None:
    """Return the first check that did not pass, None if all passed."""
    return next((check for check in checks if not check.passed), None)


def to_json(decision: str, result: str, checks: Sequence[Check]) -> str:
    """
    Return the checks of a decision as JSON, for `~/checks`.

    :param decision: what was decided, such as `model`.
    :param result: the decision in one sentence.
    """
    return json.dumps({'decision': decision, 'result': result, 'checks': [
        {'check': check.name, 'statistic': _number(check.statistic), 'limit': _number(check.limit),
         'passed_if': 'at least' if check.is_minimum else 'at most', 'passed': check.passed,
         'text': check.text} for check in checks]}, ensure_ascii=False)


def _number(value: float) -> float | None:
    return float(f'{value:.4g}') if math.isfinite(value) else None


@dataclass(frozen=True)
class CheckOptions:
    """
    Limits of the checks, and of the data that they use; ratios have no unit, evidence is in nats.

    - `max_rise`: a model may raise the RMSE of no joint by more than this factor plus its noise.
    - `significant`: standard deviations by which a model of more samples may have a larger error
      on held-out samples: its expected error is smaller, and the figures of two equal ones differ.
      Also those by which a mass or a reach may exceed its limit, and the share of gravity may be
      below it.
    - `min_noise`: smallest noise and error, as a fraction of the largest torque of the samples.
    - `min_span`, rad: range from which, with the samples of a full fit, an effort of which pose
      explains too little (`FactOptions.min_share`) has no gravity.
    - `max_own`, `max_largest`: residual of a first model as a fraction of the joint's own
      variation, and of the largest one; of a change where no chain explains the arm, `max_largest`
      of the change, or `predicted` times the noise.
    - `min_gravity`: smallest fraction of the arm's own gravity in the effort; without a tool of
      5 kg it is 0.58 on an iiwa.
    - `max_residual`: residual after the fit of a body, in units of the noise of earlier epochs.
      Real payloads reached 1.6 after 100 samples, faulty joints 3 and more.
    - `margin`: log evidence by which a fault, with or without a body, may explain the change
      better, and by which a body must do so better than a varying force, a ratio of 20. After 7 s
      a dead wrist of an arm without known axes has 3.1 and more, a real payload 4.0 at most, and
      less with each second. Payloads of 1 to 5 kg had 10 to 200 over a varying force in sixteen.
      A fault is a gain or a factor that differs from 1 by at least `min_gain_change`.
    - `max_echo`: largest ratio of the model's residual to that of the published torque.
    - `min_body`: log evidence of a body over none for a suspicion, odds of 5e8 to 1.
    - `min_over_push`: log evidence of a body over a push. Payloads of 0.5 to 5 kg had 11 to 54 in
      six seconds of motion.
    - `min_part`: share of the squared residual of each third of the window that the rest predicts.
    - `full_fit_margin`, `sparse_margin`: fraction by which a full fit must have a smaller held-out
      error than the change of the old model, and a potential than a chain. On about thirty
      samples a model that was wrong at other poses was better by a tenth.
    - `new_effects`: factor of the noise of earlier epochs where gravity is fitted jointly with
      new effects.
    - `max_outliers`: largest share of outliers; a larger one means that the model or the effort
      is wrong.
    - `min_published`, `min_published_share`: published torque that supports an arm, RMS in N·m,
      and share of the samples with published torque.
    - `min_variation`: smallest variation of the published torque of a joint that is compared, as
      a fraction of the largest.
    - `predicted`, `max_unpredicted`: residual in units of noise up to which a model predicts a
      new sample, and up to which it predicts a window of them; `max_previous`: largest ratio of
      the previous model's residual to it for a rollback.
    - `large`, `min_large`: a test for a payload is due where this share of the samples of each
      part of the window has a joint with a residual of this many times the noise.

    Priors of the hypotheses, as standard deviations:

    - `correlated`: factor of the noise for the autocorrelated model error of slow samples.
    - `body`: body on the last link, relative to half of the payload limits, or without known axes
      to `moment` times the largest residual; the scale is that of the largest evidence.
    - `force`: relative variation of the force of a hand within `force_time`, s.
    - `converged`: change of a gain at which its linearisations end.

    :raises OptionError: if a limit is not positive.
    """

    max_rise: float = 1.2
    significant: float = 2.0
    min_noise: float = 1e-3
    min_span: float = 0.5
    max_own: float = 0.35
    max_largest: float = 0.1
    min_gravity: float = 0.25
    max_residual: float = 2.5
    margin: float = 3.0
    min_gain_change: float = 0.1
    max_echo: float = 0.9
    min_body: float = 20.0
    min_over_push: float = 10.0
    min_part: float = 0.6
    full_fit_margin: float = 0.25
    sparse_margin: float = 0.1
    new_effects: float = 2.0
    max_outliers: float = 0.3
    min_published: float = 0.05
    min_published_share: float = 0.5
    min_variation: float = 0.02
    predicted: float = 4.0
    max_unpredicted: float = 6.0
    max_previous: float = 0.5
    large: float = 3.0
    min_large: float = 0.75
    correlated: float = 2.0
    body: tuple[float, ...] = (0.01, 1.0 / 30.0, 0.1, 1.0 / 3.0, 1.0)
    moment: float = 30.0
    force: float = 0.3
    force_time: float = 2.0
    converged: float = 1e-3

    def __post_init__(self) -> None:
        check_positive(self, 'checks')


OPTIONS = CheckOptions()
