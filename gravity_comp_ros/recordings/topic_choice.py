"""Choice of the topic and the joints of a recording, and detection of several arms."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
import re

from gravity_comp_ros.data.samples import joint_named, rename_hint
from gravity_comp_ros.errors import BagError, ModelMismatchError, OptionError
from gravity_comp_ros.facts.fact import Action, Fact, unless_accepted
from gravity_comp_ros.facts.joints import named_facts
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.joint_state_cdr import CDR, ROS1
from gravity_comp_ros.recordings.messages import Storage
from gravity_comp_ros.recordings.read_options import ReadOptions
import numpy as np

_DEFAULT_TOPIC = '/joint_states'


def choose_topic(path: Path, storage: Storage, requested: str | None) -> tuple[str, list[str]]:
    """
    Return the topic to read, and notes on the other JointState topics.

    :param requested: a topic; None for the only one with messages, or `/joint_states`.
    :raises BagError: if there is no such topic, or the choice is ambiguous.
    """
    if not storage.topics:
        raise BagError(f'{path} is empty: it has no topics')
    topics = {t.name: t for t in storage.topics}
    usable = [t.name for t in storage.topics if (t.type, t.encoding) in (CDR, ROS1)]
    if requested is not None:
        name = requested if requested.startswith('/') else '/' + requested
        if name in usable:
            return name, []
        listed = f'its JointState topics are {", ".join(usable)}' if usable else \
            'it has no JointState topic'
        if name in topics:
            raise BagError(f'{path}: topic {name} is a {topics[name].type} in '
                           f'{topics[name].encoding}, not a JointState in CDR; {listed}')
        raise BagError(f'{path} has no topic {name}; {listed}')
    if not usable:
        others = ', '.join(f'{t.name} ({t.type}{f" in {t.encoding}" * (t.encoding != CDR[1])})'
                           for t in [*storage.topics][:8])
        raise BagError(f'{path} has no topic of type {CDR[0]} in CDR; it has {others}')
    filled = [name for name in usable if storage.topics[topics[name]]] or usable
    if len(filled) == 1:
        return filled[0], []
    if _DEFAULT_TOPIC in filled:
        rest = ', '.join(name for name in filled if name != _DEFAULT_TOPIC)
        return _DEFAULT_TOPIC, [f'JointState topics not read: {rest}']
    raise BagError(f'{path} has several JointState topics, {", ".join(filled)}; choose one with '
                   f'--topic')


def named_joints(where: str, known: tuple[str, ...], requested: Iterable[str],
                 what: str) -> tuple[str, ...]:
    """
    Return the names of joints given by name or by number from 1.

    :param where: name of the recording in errors.
    :param what: purpose of the joints in errors.
    :raises ModelMismatchError: if a joint is unknown.
    :raises OptionError: if a joint is named twice.
    """
    requested = tuple(requested)
    matches = tuple(joint_named(text, known) for text in requested)
    unknown = [text for text, joint in zip(requested, matches) if joint is None]
    if unknown:
        raise ModelMismatchError(f'{where} has no joint {", ".join(unknown)} ({what}); it has '
                                 f'{", ".join(known)}{rename_hint(known, requested)}')
    joints = tuple(joint for joint in matches if joint is not None)
    if len(set(joints)) < len(joints):
        raise OptionError(f'a joint is named twice ({what}): {", ".join(requested)}')
    return joints


def choose_joints(where: str, columns: Columns, options: ReadOptions
                  ) -> tuple[tuple[str, ...], list[Fact]]:
    """
    Return the joints to read, and the facts on joints that are left out by their names.

    They are the chosen ones, or all in order of their first appearance.

    :param where: name of the recording in errors.
    :raises BagError: if the joints are of several arms, or one is missing in at least half of the
        messages.
    """
    facts = [] if options.joints else [unless_accepted(fact, options.accept)
                                       for fact in named_facts(columns.names)]
    left_out = {joint for fact in facts if fact.action is Action.LEFT_OUT
                for joint in fact.joints}
    joints = options.joints or tuple(name for name in columns.names if name not in left_out)
    layouts = [kept for names in columns.layouts
               if (kept := tuple(name for name in names if name not in left_out))]
    arms = [] if options.joints else arms_by_name(joints) or arms_by_message(layouts)
    if arms:
        lines = ' or '.join(f'--joints {",".join(arm)}' for arm in arms)
        found = f' has the joints of {len(arms)} arms'
        if len(layouts) > 1 and columns.is_successive():
            before, after, *_ = layouts
            found = (f': the names of the joints change from {", ".join(before)} to '
                     f'{", ".join(after)}{rename_hint(after, before)}')
        raise BagError(f'{where}{found}; choose one: {lines}')
    present = columns.presence(joints)
    present = present[present.any(axis=1)]
    missing = 1 - present.mean(axis=0)
    if (missing >= FACTS.common).any():
        worst = int(np.argmax(missing))
        good = [joint for joint, share in zip(joints, missing) if share < FACTS.common]
        good = good or [joint for joint in max(columns.layouts, key=columns.layouts.__getitem__)
                        if joint in joints]
        raise BagError(
            f'{where}: joint {joints[worst]} is missing from '
            f'{int((~present[:, worst]).sum())} of {len(present)} messages; leave it out with '
            f'--joints {",".join(good)}')
    return joints, facts


_SIDES = ('left', 'right', 'l', 'r')


def arms_by_name(names: Sequence[str]) -> list[tuple[str, ...]]:
    """
    Return the joints of each arm if arms differ in one word of the joint names, else none.

    `left_shoulder left_elbow right_shoulder right_elbow` are two arms. The word has the same
    position in all names, counted from the beginning or the end. Two arms share at least two of
    the remaining names if the word is a side, else four. Because fingers of a gripper have sides
    too, the arms must include most of the joints.
    """
    words = {name: re.split(r'[_/.\s-]+', name) for name in names}
    best: list[tuple[str, ...]] = []
    n_words = min((len(parts) for parts in words.values()), default=0)
    for position in range(-n_words, n_words):
        groups: dict[str, dict[tuple[str, ...], str]] = {}
        for name, parts in words.items():
            rest = tuple(part for k, part in enumerate(parts) if k != position % len(parts))
            groups.setdefault(parts[position].lower(), {})[rest] = name
        arms = _with_shared_names(groups)
        if sum(map(len, arms)) > sum(map(len, best)):
            best = arms
    return best if sum(map(len, best)) > FACTS.min_arms * len(names) else []


def _with_shared_names(groups: dict[str, dict[tuple[str, ...], str]]) -> list[tuple[str, ...]]:
    """Return the groups that share enough names with another group."""
    def similar(word: str, other: str) -> bool:
        minimum = FACTS.min_side_names if {word, other} <= set(_SIDES) else FACTS.min_names
        return word != other and len(groups[word].keys() & groups[other].keys()) >= minimum

    return [tuple(names.values()) for word, names in groups.items()
            if any(similar(word, other) for other in groups)]


def arms_by_message(layouts: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return arms published in separate messages: disjoint sets of at least two joints."""
    arms: list[tuple[str, ...]] = []
    for names in sorted(layouts, key=len, reverse=True):
        if len(names) >= 2 and all(not set(names) & set(other) for other in arms):
            arms.append(names)
    return arms if len(arms) > 1 else []
