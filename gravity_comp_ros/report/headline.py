"""Headline of a report: the largest error and what is missing, in one sentence."""

from __future__ import annotations

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.display import percent
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
    """Return the first finding of the headline, None if there is none."""
    diagnosis = contents.diagnosis
    return next(iter(diagnosis.found or diagnosis.findings), None) if diagnosis else None


def named_joint(contents: Contents) -> str:
    """Return the joint of the main finding, or that with the largest error."""
    finding = main_finding(contents)
    if finding is not None and finding.joint in contents.joints:
        return str(finding.joint)
    return contents.worst


def _missing(diagnosis: Diagnosis) -> str:
    if diagnosis.found:
        return f'Missing: {"; ".join(map(wording.named, diagnosis.found))}.'
    if diagnosis.findings:
        first = diagnosis.findings[0]
        return f'Not established ({first.verdict}): {wording.named(first)}.'
    if any(joint.remaining_share > 0.0 for joint in diagnosis.joints.values()):
        return 'No effect of the library explains the residual.'
    return 'Nothing is missing that is detectable in this motion.'


def _largest(contents: Contents) -> str:
    """Return a sentence on the joint with the largest error, without a full stop."""
    worst = contents.worst
    error = contents.comparison.joints[worst]
    sentence = (f'The error is largest on {worst}: {contents.error(worst)} N·m RMSE, '
                f'{percent(error.nrmse)} of the range of its torque')
    others = [contents.comparison.joints[name].rmse for name in contents.joints if name != worst]
    median = float(np.median(others)) if others else 0.0
    if median > 0.0 and error.rmse > _REPORTED_RATIO * median:
        sentence += f' and {error.rmse / median:.2g} times that of the other joints'
    return sentence


def _noise(contents: Contents, name: str) -> float:
    return float(contents.model.noise[contents.model.joints.index(name)])
