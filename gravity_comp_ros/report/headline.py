"""Headline of a report: the largest error and what is missing, in one sentence."""

from __future__ import annotations

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.report.contents import Contents
import numpy as np

# Ratio of an error to the training error beyond statistical uncertainty.
_WORSE = 2.0
# Ratio of an error to the median error of the other joints that is reported.
_REPORTED_RATIO = 3.0


def headline(contents: Contents) -> str:
    """Return the largest error, and the missing effects or the joints with unusual errors."""
    if contents.diagnosis is not None:
        return f'{_largest(contents)}. {_missing(contents.diagnosis)}'
    errors = {name: contents.comparison.joints[name] for name in contents.joints}
    useless = [name for name, joint in errors.items()
               if joint.rmse > joint.rmse_constant and joint.rmse > 3.0 * _noise(contents, name)]
    if 2 * len(useless) > len(errors):
        return (f'The model is worse than a constant on {", ".join(useless)}: the arm, the signs '
                f'or units of the effort, or the payload differ from those of the fit.')
    worse = [name for name, joint in errors.items()
             if joint.rmse > _WORSE * _noise(contents, name)]
    if worse:
        return (f'{_largest(contents)}; more than twice the training error: '
                f'{", ".join(worse)}.')
    return f'{_largest(contents)}; no error exceeds twice the training error.'


def main_finding(contents: Contents) -> Finding | None:
    """Return the finding of the headline, if it reduces the error visibly."""
    findings = contents.diagnosis.findings if contents.diagnosis else ()
    accepted = [f for f in findings if f.is_missing] or list(findings)
    return accepted[0] if accepted and _visible(accepted[0]) else None


def named_joint(contents: Contents) -> str:
    """Return the joint of the main finding, or that with the largest error."""
    finding = main_finding(contents)
    if finding is not None and finding.joint in contents.joints:
        return str(finding.joint)
    return contents.worst


def _missing(diagnosis: Diagnosis) -> str:
    """Return the missing effects; those that do not reduce the error are not missing."""
    accepted = [f for f in diagnosis.findings if f.is_missing]
    visible = [f for f in accepted if _visible(f)]
    if visible:
        return f'Missing: {"; ".join(map(_named, visible))}.'
    if accepted:
        names = ', '.join(dict.fromkeys(f.effect or 'an unknown effect' for f in accepted))
        return f'No missing effect changes the error; detected: {names}.'
    if diagnosis.findings:
        first = diagnosis.findings[0]
        return f'Not established ({first.verdict}): {_named(first)}.'
    if any(joint.remaining_share > 0.0 for joint in diagnosis.joints.values()):
        return 'No effect of the library explains the residual.'
    return 'Nothing is missing that is detectable in this motion.'


def _named(finding: Finding) -> str:
    size = wording.sizes(finding.coefficients)
    return (f'{wording.title(finding.effect) if finding.effect else "an unknown effect"} on '
            f'{wording.where(finding)}{f" ({size})" if size else ""}')


def _visible(finding: Finding) -> bool:
    """Return whether the error decreases by at least one shown digit."""
    return wording.percent(finding.nrmse_before) != wording.percent(finding.nrmse_after) \
        and finding.nrmse_after < finding.nrmse_before


def _largest(contents: Contents) -> str:
    """Return a sentence on the joint with the largest error, without a full stop."""
    worst = contents.worst
    error = contents.comparison.joints[worst]
    sentence = (f'The error is largest on {worst}: {contents.error(worst)} N·m RMSE, '
                f'{wording.percent(error.nrmse)} of the range of its torque')
    others = [contents.comparison.joints[name].rmse for name in contents.joints if name != worst]
    median = float(np.median(others)) if others else 0.0
    if median > 0.0 and error.rmse > _REPORTED_RATIO * median:
        sentence += f' and {error.rmse / median:.2g} times that of the other joints'
    return sentence


def _noise(contents: Contents, name: str) -> float:
    return float(contents.model.noise[contents.model.joints.index(name)])
