"""`Fact`: a property of a recording, its evidence, and what is done about it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Any

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.printable import counted
from numpy.typing import NDArray


# Facts are about the effort as read: a scale that they name is a factor of the scale of reading.
TIMES_GIVEN = 'times any scale already given'


class Kind(StrEnum):
    """The kinds of facts, by their names in JSON and of `--accept`."""

    EFFORT_UNIT = 'effort_unit'
    ANGLE_UNIT = 'angle_unit'
    EFFORT_SIGN = 'effort_sign'
    EFFORT_GAIN = 'effort_gain'
    DEAD_EFFORT = 'dead_effort'
    CONSTANT_EFFORT = 'constant_effort'
    FROZEN = 'frozen'
    SATURATED = 'saturated_effort'
    SPIKES = 'effort_spikes'
    GLITCHES = 'position_glitches'
    WRAPS = 'wrapped_positions'
    DISABLED = 'drive_disabled'
    VELOCITY = 'velocity'
    LAG = 'effort_lag'
    GRIPPER = 'gripper'
    LINEAR_JOINT = 'linear_joint'
    PUBLISHER = 'second_publisher'
    ORDER = 'joint_order'
    AXES = 'described_axes'
    COMPENSATED = 'compensated_gravity'
    MOVED_BASE = 'moved_base'
    MOTION = 'motion'


class Action(StrEnum):
    """Default treatment of a fact."""

    NOTED = 'noted'
    CORRECTED = 'corrected'
    LEFT_OUT = 'left_out'
    REFUSED = 'refused'


@dataclass(frozen=True)
class Fact:
    """
    One fact.

    - `joints`: the joints concerned; empty for the whole recording.
    - `evidence`: a clause with the numbers that show it.
    - `done`: what is done by default, or what the reader should know.
    - `otherwise`: the option that does otherwise or lifts a refusal, '' for none.
    - `values`: the numbers of the evidence by joint, in the unit that the evidence names.
    """

    kind: Kind
    joints: tuple[str, ...]
    evidence: str
    action: Action
    done: str = ''
    otherwise: str = ''
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def sentence(self) -> str:
        """Return evidence, action and option in one sentence."""
        text = f'{self.evidence}: {self.done}' if self.done else self.evidence
        return f'{text} ({self.otherwise})' if self.otherwise else text

    def to_json(self) -> dict[str, Any]:
        """Return the fact as an object of `--json`."""
        return {'kind': self.kind, 'joints': sorted(self.joints), 'evidence': self.evidence,
                'action': self.action, 'done': self.done, 'option': self.otherwise,
                'values': dict(self.values)}


def check_kinds(names: Collection[str]) -> None:
    """
    Check names of kinds of facts.

    :raises OptionError: if one is unknown.
    """
    unknown = sorted(set(names) - set(Kind))
    if unknown:
        raise OptionError(f'no kind of fact is named {", ".join(unknown)}; they are '
                          f'{", ".join(Kind)}')


def refused(facts: Sequence[Fact]) -> list[Fact]:
    """Return the facts for which a recording is refused."""
    return [fact for fact in facts if fact.action is Action.REFUSED]


def unless_accepted(fact: Fact, accept: Collection[str]) -> Fact:
    """Return a fact; of an accepted kind it is noted, and the recording is read as it is."""
    return fact if fact.kind not in accept else replace(
        fact, action=Action.NOTED, done='accepted', otherwise='')


def rows_left_out(kind: Kind, joints: Sequence[str], evidence: str, rows: NDArray,
                  values: Mapping[str, float] = MappingProxyType({}),
                  reason: str = '') -> Fact:
    """
    Return the fact that the samples of a mask (M,) are left out.

    :param reason: begins the clause about them.
    """
    return Fact(kind, tuple(joints), evidence, Action.LEFT_OUT,
                f'{reason}{counted(int(rows.sum()), "sample")} left out',
                f'--accept {kind} keeps them', values)


def listed(names: Sequence[str], total: int) -> str:
    """Return the names of joints, `every joint` if they are all of several."""
    return 'every joint' if len(names) == total > 1 else ', '.join(names)
