"""The answer in one sentence."""

from __future__ import annotations

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.report.contents import Contents
import numpy as np

# So many times the error of training is more than chance.
_WORSE = 2.0
# So many times the error of the other joints stands out.
_STANDS_OUT = 3.0


def headline(contents: Contents) -> str:
    """Return the diagnosis in a sentence, or the accuracy of the model where there is none."""
    if contents.diagnosis is not None:
        return diagnosed(contents.diagnosis)
    found = {name: contents.comparison.joints[name] for name in contents.joints}
    useless = [name for name, joint in found.items()
               if joint.rmse > joint.rmse_constant and joint.rmse > 3.0 * _noise(contents, name)]
    if 2 * len(useless) > len(found):
        return (f'The model is worse than a constant on {", ".join(useless)}: it is of another '
                f'arm, the signs or units of the effort differ, or the payload does.')
    told = largest(contents)
    worse = [name for name, joint in found.items()
             if joint.rmse > _WORSE * _noise(contents, name)]
    if worse:
        return f'{told}; more than twice the error of training: {", ".join(worse)}.'
    return f'{told}; no joint is much worse than in training.'


def diagnosed(diagnosis: Diagnosis) -> str:
    """Return the diagnosis in a sentence; an effect that changes no error is not missing."""
    found = [f for f in diagnosis.findings if f.verdict in wording.FOUND]
    if found and not any(visible(f) for f in found):
        names = ', '.join(dict.fromkeys(f.effect or 'something unknown' for f in found[:3]))
        return (f'Nothing is missing that changes the error: {names} '
                f'{"is" if len(found) == 1 else "are"} detected, and the held-out error stays at '
                f'{wording.percent(found[0].nrmse_before)} of the range of the torque.')
    return wording.verdict(diagnosis)


def visible(finding: Finding) -> bool:
    """Return whether the error falls by more than the digits that are shown can hide."""
    return wording.percent(finding.nrmse_before) != wording.percent(finding.nrmse_after) \
        and finding.nrmse_after < finding.nrmse_before


def named_joint(contents: Contents) -> str:
    """Return the joint that the headline is about; tables stress the same one."""
    diagnosis = contents.diagnosis
    if diagnosis is not None and diagnosis.findings:
        found = [f for f in diagnosis.findings if f.verdict in wording.FOUND]
        joint = (found or list(diagnosis.findings))[0].joint
        if joint in contents.joints and joint is not None:
            return joint
    return contents.worst


def largest(contents: Contents) -> str:
    """Return where the error is largest, without a full stop."""
    worst = contents.worst
    found = contents.comparison.joints[worst]
    told = (f'The error is largest on {worst}: {found.rmse:.3g} N·m RMSE, '
            f'{wording.percent(found.nrmse)} of the range of its torque')
    others = [contents.comparison.joints[name].rmse for name in contents.joints if name != worst]
    usual = float(np.median(others)) if others else 0.0
    if usual > 0.0 and found.rmse > _STANDS_OUT * usual:
        told += f' and {found.rmse / usual:.2g} times that of the other joints'
    return told


def _noise(contents: Contents, name: str) -> float:
    return float(contents.model.noise[contents.model.joints.index(name)])
