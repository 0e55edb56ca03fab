"""Facts on the joints of recordings against each other, and their refusal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gravity_comp_ros.api.read import read_recording
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import known_arm, KnownArm
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.joint_order import NUMBERS, WORDS
from gravity_comp_ros.errors import BagError, DataError
from gravity_comp_ros.estimation.joint_gains import GainOptions
from gravity_comp_ros.estimation.torque_facts import torque_facts, WholeArm
from gravity_comp_ros.facts.fact import accepted_kinds, Fact, refused, unless_accepted
from gravity_comp_ros.models.gravity_model import GravityModel


def arm_facts(recording: Recording, arm: KnownArm | None = None,
              model: GravityModel | None = None,
              limits: GainOptions = GainOptions()) -> list[Fact]:
    """
    Return the facts on the order of the names, axes, gains, and the vertical, of files.

    :param arm: axes and joint order; None for those of the model.
    :param model: see `torque_facts`.
    :param limits: of gains.
    """
    rotations, by_name = None, False
    if arm is not None:
        recording, geometry = arm.of(recording), arm.axes.geometry
        rotations = None if geometry is None else geometry.rotations
        by_name = geometry is None and arm.order.source in (NUMBERS, WORDS)
    facts = torque_facts(recording.samples, rotations, model, _whole_arm(recording), by_name,
                         limits)
    accept = accepted_kinds(recording.reports[0].options.accept)
    return [unless_accepted(fact, accept) for fact in facts]


def check_facts(facts: Sequence[Fact], where: str = '', why: str = '') -> None:
    """
    Check that no fact is refused.

    :param where: the recording, before the refusal; `why`: a sentence after it.
    :raises DataError: if one is.
    """
    for fact in refused(facts):
        raise DataError(f'{where}: ' * bool(where) + fact.sentence + f'. {why}' * bool(why))


def _whole_arm(recording: Recording) -> WholeArm:
    """Return the reader of the recordings with the joints that their options leave out."""
    def read() -> JointSamples | None:
        every = replace(recording.reports[0].options, joints=None, refuse=False)
        try:
            whole = read_recording([each.path for each in recording.reports], every, None)
        except BagError:
            return None
        return known_arm(whole).of(whole).samples
    return read
