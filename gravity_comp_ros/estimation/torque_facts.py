"""
Facts on the efforts of the joints against each other: order of names, axes, gains, vertical.

The torques of all joints come from one arm (`ArmFit`). Each fact is another hypothesis about it
that explains the efforts, while equal gains, a base at rest and the names do not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.arm_fit import ArmFit, moves_enough
from gravity_comp_ros.estimation.axis_directions import axis_facts
from gravity_comp_ros.estimation.joint_gains import common_gain, joint_gains
from gravity_comp_ros.estimation.moved_base import moved_base
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.models.gravity_model import GravityModel

# Reads the samples of all joints in their order; None if they cannot be read.
WholeArm = Callable[[], JointSamples | None]
# Joints at the end of an arm that are not exchanged with the first one: the wrist.
_WRIST = 3


def torque_facts(samples: JointSamples, rotations: FloatArray | None = None,
                 model: GravityModel | None = None, whole: WholeArm = lambda: None,
                 by_name: bool = False, min_ratio: float = OPTIONS.min_ratio) -> list[Fact]:
    """
    Return the facts that names are exchanged, axes reversed, gains differ, or the base moved.

    :param samples: joints from the base outwards.
    :param rotations: of described axes.
    :param model: of the arm before; its axes count if none are described, and the gains are
        relative to a joint that agrees with it.
    :param whole: reads all joints, called if the vertical changes: the samples may be of a part
        of an arm, on a link that other joints tilt.
    :param by_name: whether the order of the joints is that of their names.
    :param min_ratio: of gains that are refused.
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
    facts = facts or (_order_facts(fit, samples) if by_name else [])
    if facts:
        return facts

    def gain_facts(fit: ArmFit, part: JointSamples) -> list[Fact]:
        gains = joint_gains(fit)
        return (gains if model is None else gains.relative_to(model, part)).facts(min_ratio)

    facts = gain_facts(fit, samples)
    if facts:
        return facts
    facts = [] if model is None else common_gain(model, samples)
    if facts:
        return facts
    base = moved_base(fit)
    facts = [] if base is None else base.facts()
    every = whole() if facts else None
    if every is not None and every.n_joints > samples.n_joints and moves_enough(every):
        base = moved_base(ArmFit(every))
        facts = [] if base is None else base.facts()
    return facts or ([] if fit.is_white(fit.plain) else _facts_of_one(
        samples, lambda alone: gain_facts(ArmFit(alone, rotations), alone)))


def _facts_of_one(samples: JointSamples,
                  facts_of: Callable[[JointSamples], list[Fact]]) -> list[Fact]:
    """Return the facts of one of several recordings, the first that has any."""
    for alone in samples.each_run() if samples.n_runs > 1 else ():
        facts = facts_of(alone) if moves_enough(alone) else []
        if facts:
            return [replace(fact, evidence=f'in {alone.run_labels[0]}: {fact.evidence}',
                            otherwise=f'without this recording the others can be learned; of it '
                                      f'alone, {fact.otherwise}') for fact in facts]
    return []


def _order_facts(fit: ArmFit, samples: JointSamples) -> list[Fact]:
    """Return the fact that one arm explains the efforts with other names of the joints only."""
    if fit.is_white(fit.plain):
        return []
    names = samples.names
    for labels in dict.fromkeys(_labels(names)):
        # The values are of these joints: in the order of the arm they explain the efforts.
        other = ArmFit(samples.joints([names[labels.index(name)] for name in names]))
        if other.is_better(other.plain, fit.plain):
            renames = {old: new for old, new in zip(names, labels) if old != new}
            pairs = ','.join(f'{old}={new}' for old, new in renames.items())
            values = ' and '.join(f'{old} has the values of {new}'
                                  for old, new in renames.items())
            return [Fact(
                Kind.ORDER, tuple(renames), f'no arm has these efforts in the order of the names; '
                f'one has them if {values}', Action.REFUSED,
                'the values are in another order than the names, as after a sort by name',
                f'--rename {pairs}, or --accept {Kind.ORDER} if the names are right')]
    return []


def _labels(names: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield names that the values may have, instead of these in the order of the arm."""
    by_name = tuple(sorted(names))
    if by_name != names:
        yield by_name
        yield tuple(names[by_name.index(name)] for name in names)
    for k in range(1, len(names) - _WRIST):
        yield (names[k], *names[1:k], names[0], *names[k + 1:])
