"""Added effects that a recording does not distinguish from alternative effects."""

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

_NOT_DISTINGUISHED = (Verdict.AMBIGUOUS, Verdict.UNTESTABLE)


def ambiguous_additions(model: GravityModel, recording: Recording,
                        added: Sequence[str]) -> tuple[Finding, ...]:
    """
    Return the findings on added effects that have an equivalent alternative.

    The added effects are compared with their confounders only, jointly with the earlier effects
    of the model. The result is empty if there are too few samples.

    :param model: the model without the added effects.
    :param added: the added effects, on every joint (`NAME`) or on one
        (`NAME:JOINT`).
    :raises ModelMismatchError: if a joint of the model is missing in the recording.
    """
    known = all_effects()
    names = {name.partition(':')[0] for name in added} & known.keys()
    # An effect of the whole arm can replace effects on several joints at once. That is no
    # alternative to a single one of them.
    alternatives = {other for name in names for other in known[name].confounders
                    if other in known and known[other].scope == known[name].scope}
    if not alternatives:
        return ()
    recording = recording.select_joints(model.joints)
    samples = recording.samples.select(not_held_out(model, recording))
    options = DiagnosisOptions(effects=tuple(sorted(names | alternatives)))
    try:
        diagnosis = diagnose(samples, model, options)
    except DataError:
        return ()
    targets = {*added, *(f'{name}:{joint}' for name in names if name in added
                         for joint in model.joints)}
    return tuple(f for f in diagnosis.findings if f.verdict in _NOT_DISTINGUISHED and f.rivals
                 and f.effect and target(f.effect, f.joint) in targets)
