"""What a diagnosis says of a target: settled, and how, or still open."""

from __future__ import annotations

from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, FOUND
from gravity_comp_ros.planning.options import Target

# No finding, though the recordings could show the effect.
ABSENT = 'absent'
UNTESTABLE = 'untestable'
SETTLED = (*map(str, FOUND), ABSENT)


def finding_of(target: Target, diagnosis: Diagnosis | None) -> Finding | None:
    """Return what was found of a target, if anything."""
    return next((f for f in (diagnosis.findings if diagnosis else ())
                 if (f.effect, f.joint) == (target.effect, target.joint)), None)


def outcome(target: Target, diagnosis: Diagnosis) -> str:
    """Return the verdict on a target, `absent` or `untestable`."""
    finding = finding_of(target, diagnosis)
    if finding is not None:
        return str(finding.verdict)
    if target.joint is None:
        reasons = diagnosis.untestable
    else:
        reasons = diagnosis.joints[target.joint].untestable
    return UNTESTABLE if target.effect in reasons else ABSENT
