"""Headline of a report: the main result in one sentence."""

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
    """Return the diagnosis in a sentence, or the accuracy of the model without a diagnosis."""
    if contents.diagnosis is not None:
        return diagnosed(contents.diagnosis)
    errors = {name: contents.comparison.joints[name] for name in contents.joints}
    useless = [name for name, joint in errors.items()
               if joint.rmse > joint.rmse_constant and joint.rmse > 3.0 * _noise(contents, name)]
    if 2 * len(useless) > len(errors):
        return (f'The model is worse than a constant on {", ".join(useless)}: the arm, the signs '
                f'or units of the effort, or the payload differ from those of the fit.')
    sentence = largest(contents)
    worse = [name for name, joint in errors.items()
             if joint.rmse > _WORSE * _noise(contents, name)]
    if worse:
        return f'{sentence}; more than twice the training error: {", ".join(worse)}.'
    return f'{sentence}; no error exceeds twice the training error.'


def diagnosed(diagnosis: Diagnosis) -> str:
    """Return the diagnosis in a sentence; effects that do not reduce the error are not missing."""
    accepted = [f for f in diagnosis.findings if f.verdict in wording.FOUND]
    if accepted and not any(visible(f) for f in accepted):
        names = ', '.join(dict.fromkeys(f.effect or 'an unknown effect' for f in accepted[:3]))
        return (f'No missing effect changes the error: {names} '
                f'{"is" if len(accepted) == 1 else "are"} detected, and the held-out error '
                f'remains {wording.percent(accepted[0].nrmse_before)} of the range of the torque.')
    return wording.verdict(diagnosis)


def visible(finding: Finding) -> bool:
    """Return whether the error decreases by at least one shown digit."""
    return wording.percent(finding.nrmse_before) != wording.percent(finding.nrmse_after) \
        and finding.nrmse_after < finding.nrmse_before


def named_joint(contents: Contents) -> str:
    """Return the joint of the headline, which tables emphasise."""
    diagnosis = contents.diagnosis
    if diagnosis is not None and diagnosis.findings:
        accepted = [f for f in diagnosis.findings if f.verdict in wording.FOUND]
        joint = (accepted or list(diagnosis.findings))[0].joint
        if joint in contents.joints and joint is not None:
            return joint
    return contents.worst


def largest(contents: Contents) -> str:
    """Return a sentence on the joint with the largest error, without a full stop."""
    worst = contents.worst
    error = contents.comparison.joints[worst]
    sentence = (f'The error is largest on {worst}: {error.rmse:.3g} N·m RMSE, '
                f'{wording.percent(error.nrmse)} of the range of its torque')
    others = [contents.comparison.joints[name].rmse for name in contents.joints if name != worst]
    median = float(np.median(others)) if others else 0.0
    if median > 0.0 and error.rmse > _REPORTED_RATIO * median:
        sentence += f' and {error.rmse / median:.2g} times that of the other joints'
    return sentence


def _noise(contents: Contents, name: str) -> float:
    return float(contents.model.noise[contents.model.joints.index(name)])
