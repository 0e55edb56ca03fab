"""Effects that may be added although a recording does not distinguish them from others."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import not_held_out
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Finding, Verdict
from gravity_comp_ros.diagnosis.options import DiagnosisOptions
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel

_TIED = (Verdict.AMBIGUOUS, Verdict.UNTESTABLE)


def ties_of(model: GravityModel, recording: Recording,
            added: Sequence[str]) -> tuple[Finding, ...]:
    """
    Return what the recording says of effects that another one would explain as well.

    Only the effects that were added and those that are known to look like them are compared,
    beside the effects that the model had before. Where samples are too few to compare, there
    are none.

    :param model: before the effects were added.
    :param added: the effects, as `NAME` or `NAME:JOINT`.
    :raises ModelMismatchError: if the recording lacks a joint of the model.
    """
    known = all_effects()
    names = {name.partition(':')[0] for name in added} & known.keys()
    # An effect of the arm can stand for several of joints at once, which is no tie of one of them.
    alike = {other for name in names for other in known[name].confounders
             if other in known and known[other].scope == known[name].scope}
    if not alike:
        return ()
    recording = recording.select_joints(model.joints)
    samples = recording.samples.select(not_held_out(model, recording))
    try:
        found = diagnose(samples, model, DiagnosisOptions(effects=tuple(sorted(names | alike))))
    except DataError:
        return ()
    wanted = {*added, *(f'{name}:{joint}' for name in names if name in added
                        for joint in model.joints)}
    return tuple(f for f in found.findings if f.verdict in _TIED and f.rivals and f.effect
                 and target(f.effect, f.joint) in wanted)
