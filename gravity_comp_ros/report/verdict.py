"""The answer in one sentence."""

from __future__ import annotations

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.report.contents import Contents

# So many times the error of training is more than chance.
_WORSE = 2.0


def verdict(contents: Contents) -> str:
    """Return the diagnosis in a sentence, or how good the model is where there is none."""
    if contents.diagnosis is not None:
        return wording.verdict(contents.diagnosis)
    found = {name: contents.comparison.joints[name] for name in contents.joints}
    useless = [name for name, joint in found.items()
               if joint.rmse > joint.rmse_constant and joint.rmse > 3.0 * _noise(contents, name)]
    if 2 * len(useless) > len(found):
        return (f'The model is worse than a constant on {", ".join(useless)}: it is of another '
                f'arm, the signs or units of the effort differ, or the payload does.')
    told = largest(contents)
    worse = [name for name, joint in found.items()
             if joint.rmse > _WORSE * _noise(contents, name)]
    if not worse:
        return f'No joint is much worse than in training; {told[0].lower()}{told[1:]}.'
    return f'{told}; worse than twice the error of training: {", ".join(worse)}.'


def largest(contents: Contents) -> str:
    """Return where the error is largest, without a full stop."""
    worst = contents.worst
    found = contents.comparison.joints[worst]
    return (f'The error is largest on {worst}: {found.rmse:.3g} N·m RMSE, '
            f'{wording.percent(found.nrmse)} of the range of its torque')


def _noise(contents: Contents, name: str) -> float:
    return float(contents.model.noise[contents.model.joints.index(name)])
