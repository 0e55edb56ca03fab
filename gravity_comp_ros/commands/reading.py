"""Recordings and robot description of a verb, and the lines shown about them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.learn import known_arm, KnownArm
from gravity_comp_ros.api.read import read_recording
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.commands.arguments import gate, read_options
from gravity_comp_ros.commands.terminal import ProgressCallback
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.description.joint_order import NUMBERS, WORDS
from gravity_comp_ros.description.links import described_arm, DescribedArm
from gravity_comp_ros.description.robot_tree import arm_joints
from gravity_comp_ros.description.urdf import HeldPositions, read_text
from gravity_comp_ros.errors import BagError, DataError, Hint
from gravity_comp_ros.estimation.arm_fit import ArmFit, moves_enough
from gravity_comp_ros.estimation.axis_directions import axis_facts
from gravity_comp_ros.estimation.joint_gains import joint_gains
from gravity_comp_ros.estimation.moved_base import moved_base
from gravity_comp_ros.facts.fact import as_noted, Fact
from gravity_comp_ros.facts.order import order_facts
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.recordings.robot_description import first_description

# Reads the samples of all joints in their order; None if they cannot be read.
WholeArm = Callable[[], JointSamples | None]


def load(args: argparse.Namespace, report: ProgressCallback,
         is_gated: bool = True) -> Recording:
    """
    Return the recording of `args.bags`.

    :param is_gated: whether to apply the gate of the arguments; False for verbs that select
        samples themselves.
    :raises BagError: if a bag cannot be read.
    :raises ModelMismatchError: if two bags are of different robots.
    """
    return read_recording(args.bags, read_options(args), gate(args) if is_gated else None, report)


def arm_facts(recording: Recording, arm: KnownArm, accept: Collection[str] = (),
              model: GravityModel | None = None, whole: WholeArm = lambda: None) -> list[Fact]:
    """
    Return the facts on the joints against each other.

    They are on the order of the names, the axes of the description, the gains of the efforts and
    the vertical.

    :param accept: names of kinds that are noted, whatever is done about them otherwise.
    :param model: see `torque_facts`.
    :param whole: see `torque_facts`.
    """
    samples, geometry = arm.of(recording).samples, arm.axes.geometry
    by_name = geometry is None and arm.order.source in (NUMBERS, WORDS)
    facts = order_facts(samples, arm.order.joints) if by_name else []
    rotations = None if geometry is None else geometry.rotations
    facts = facts or torque_facts(samples, rotations, model, whole)
    return [as_noted(fact) if fact.kind.value in accept else fact for fact in facts]


def whole_arm(args: argparse.Namespace, paths: Sequence[Path]) -> WholeArm:
    """Return the reader of the recordings with the joints that `args.joints` leaves out."""
    def read() -> JointSamples | None:
        options = replace(read_options(args), joints=None, refuse=False)
        try:
            recording = read_recording(paths, options, None)
        except BagError:
            return None
        return known_arm(recording).of(recording).samples
    return read


def torque_facts(samples: JointSamples, rotations: FloatArray | None = None,
                 model: GravityModel | None = None,
                 whole: WholeArm = lambda: None) -> list[Fact]:
    """
    Return the facts that axes are reversed, gains disagree, or the vertical changes.

    :param rotations: of described axes.
    :param model: of the arm before; its axes count if none are described, and the gains are
        relative to a joint that agrees with it.
    :param whole: reads all joints, called if the vertical changes: the samples may be of a part
        of an arm, on a link that other joints tilt.
    """
    if model is not None and rotations is None:
        samples = samples.joints(model.joints)
    if not moves_enough(samples):
        return []
    fit = ArmFit(samples, rotations)
    facts: list[Fact] = []
    if rotations is not None:
        facts = axis_facts(fit, rotations)
    elif model is not None and model.chain is not None:
        facts = axis_facts(fit, model.chain.axes, model)
    if facts:
        return facts
    gains = joint_gains(fit)
    if gains.facts():
        return (gains if model is None else gains.relative_to(model, samples)).facts()
    base = moved_base(fit)
    facts = [] if base is None else base.facts()
    every = whole() if facts else None
    if every is not None and every.n_joints > samples.n_joints and moves_enough(every):
        base = moved_base(ArmFit(every))
        facts = [] if base is None else base.facts()
    return facts


def lines(recording: Recording) -> list[str]:
    """Return plain lines on the bags and the gate; they may contain text from the bags."""
    return [*bag_lines(recording.reports), recording.gated.sentence()]


def bag_lines(reports: Sequence[ReadReport]) -> list[str]:
    """Return plain lines on the bags; they may contain text from the bags."""
    result = []
    for report in reports:
        result.append(
            f'{report.path.name}: {report.topic}, {counted(report.n_samples, "sample")} at '
            f'{report.rate_hz:.3g} Hz over {report.duration_s:.1f} s, '
            f'velocity {report.velocity}')
        result += [f'  dropped {count} of {counted(report.n_messages, "message")}: {reason}'
                   for reason, count in report.dropped.items() if count]
        result += [f'  {note}' for note in report.notes]
    return result


def fitted_names(model: GravityModel | None, reports: Sequence[ReadReport]) -> list[str]:
    """Return the names of those recordings that the model was fitted to."""
    known = {bag['sha256'] for bag in model.provenance.get('bags', ())} if model else set()
    return [report.path.name for report in reports if report.sha256 in known]


def fitted_lines(model: GravityModel | None, reports: Sequence[ReadReport]) -> list[str]:
    """Return a plain line on fitted and new recordings."""
    if model is None:
        return ['no --model: gravity is fitted jointly with the effects']
    old = fitted_names(model, reports)
    new = [report.path.name for report in reports if report.path.name not in old]
    parts = [f'fitted to {", ".join(old)}'] if old else []
    parts += [f'not fitted to {", ".join(new)}'] if new else []
    return [f'the model was {" and ".join(parts)}; errors are cross-validated, so fitted '
            'recordings are valid as well']


def scale_warnings(model: GravityModel, reports: Sequence[ReadReport]) -> list[str]:
    """Return a warning if the effort scales differ from those of the fit."""
    fitted: dict[str, float] = {}
    for bag in model.provenance.get('bags', ()):
        fitted.update({joint: bag['effort_scale'].get(joint, 1.0) for joint in model.joints})
    differ = sorted({joint for report in reports for joint, scale in fitted.items()
                     if report.effort_scale.get(joint, 1.0) != scale}, key=model.joints.index)
    if not differ:
        return []
    scales = ','.join(f'{joint}={fitted[joint]:g}' for joint in differ)
    return [f'the model was fitted with another effort scale of {", ".join(differ)}: '
            f'unless the driver has changed, use --effort-scale {scales}']


def description_of(args: argparse.Namespace,
                   reports: Sequence[ReadReport]) -> tuple[bytes | str, str]:
    """
    Return the text of the description and its source for messages.

    :raises DataError: if there is none.
    """
    if args.urdf is not None:
        return read_text(args.urdf), str(args.urdf)
    recorded = first_description(report.path for report in reports)
    if recorded is None:
        raise DataError('no recording contains a robot description', Hint.NAME_DESCRIPTION)
    return recorded.text, recorded.source


def described_arm_of(args: argparse.Namespace, text: bytes | str, source: str,
                     recorded: Sequence[str]) -> DescribedArm:
    """Return the described arm among the recorded joints, with the joints of --fixed held."""
    return described_arm(text, arm_joints(text, recorded, source).joints, source,
                         HeldPositions(args.fixed))
