"""Selection of table columns by pattern, list of names, or range of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import re

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.printable import shown_names

_RANGE = re.compile(r'(\d+)-(\d+)$')
_MAX_NAMES = 30


def _shapes(before: str, words: Sequence[str], after: str) -> tuple[re.Pattern[str], ...]:
    return tuple(re.compile(f'{before.format(word)}(?P<joint>[^/]+?){after.format(word)}$', re.I)
                 for word in words)


_LONG = ('position', 'velocity', 'effort')
# Servos and loggers: `elbow.pos`, `elbow.vel`, and one of these.
_SERVO = tuple(('pos', 'vel', effort) for effort in ('load', 'effort', 'eff', 'torque', 'current'))
_TOPIC = r'(?:(?P<topic>.*)/)?'
# Patterns for position, velocity, effort; the first is the format of PlotJuggler.
_NAMED = (_shapes(_TOPIC, _LONG, '/{}'), _shapes(_TOPIC + '{}_', _LONG, ''),
          _shapes(_TOPIC, _LONG, '_{}'), _shapes(_TOPIC, _LONG, '[.]{}'),
          _shapes(_TOPIC + '{}_', ('q', 'qd', 'tau'), ''),
          *(_shapes(_TOPIC + before, words, after) for words in _SERVO
            for before, after in (('', '[.]{}'), ('{}_', ''), ('', '_{}'))),
          *(_shapes(_TOPIC, (*_LONG[:2], effort), '_{}') for effort in ('torque', 'current')))


def find_columns(columns: Sequence[str], selection: str, what: str, where: str) -> list[int]:
    """
    Return the indices of the columns selected by `selection`.

    A pattern such as `q_{i}` selects the columns with a number at `{i}`, sorted by it. Otherwise
    `selection` is a list of names, numbers from 1 and ranges, as in `a,b,7-9`. Names take
    precedence over numbers.

    :param what: purpose of the columns in errors.
    :param where: name of the file in errors.
    :raises BagError: if a column is missing or selected twice, or a number is missing.
    """
    if '{i}' in selection:
        return _pattern(columns, selection, what, where)
    selected: list[int] = []
    for item in (part.strip() for part in selection.split(',')):
        selected += _item(columns, item, what, where)
    repeated = sorted({columns[k] for k in selected if selected.count(k) > 1})
    if repeated:
        raise BagError(f'{where}: column {", ".join(repeated)} is given twice for {what}')
    return selected


@dataclass(frozen=True)
class Columns:
    """Indices of the columns used, and joint names if the columns have them."""

    position: list[int]
    velocity: list[int]
    effort: list[int]
    joints: tuple[str, ...] | None = None
    time: int | None = None

    @property
    def used(self) -> list[int]:
        """Return all columns that are used."""
        time = [] if self.time is None else [self.time]
        return [*self.position, *self.velocity, *self.effort, *time]


def named_columns(columns: Sequence[str], where: str) -> Columns | None:
    """
    Return the columns named after joints, as `/joint_states/elbow/position` or `position_elbow`.

    :param where: name of the file in errors.
    :raises BagError: if the columns are of several topics.
    """
    for shapes in _NAMED:
        position, velocity, effort = (_by_joint(columns, shape) for shape in shapes)
        topics = sorted({topic for topic, _ in position} & {topic for topic, _ in effort})
        if '/joint_states' in topics:
            topics = ['/joint_states']
        if len(topics) > 1:
            raise BagError(f'{where} has joints of several topics, {", ".join(topics)}; name the '
                           f'columns (--position, --effort)')
        for topic in topics:
            joints = tuple(joint for of, joint in position
                           if of == topic and (of, joint) in effort)
            if joints:
                keys = [(topic, joint) for joint in joints]
                speeds = [velocity[key] for key in keys if key in velocity]
                return Columns([position[key] for key in keys],
                               speeds if len(speeds) == len(keys) else [],
                               [effort[key] for key in keys], joints)
    return None


def _by_joint(columns: Sequence[str], shape: re.Pattern[str]) -> dict[tuple[str, str], int]:
    """Return the column indices by topic and joint."""
    return {(match['topic'] or '', match['joint']): k for k, name in enumerate(columns)
            if (match := shape.match(name))}


def has_columns(columns: Sequence[str], selection: str) -> bool:
    """Return whether any column matches the pattern or name `selection`."""
    shape = _shape(selection)
    return any(shape.match(name) for name in columns)


def _pattern(columns: Sequence[str], selection: str, what: str, where: str) -> list[int]:
    shape = _shape(selection)
    numbered = sorted((int(match[1]), k) for k, name in enumerate(columns)
                      if (match := shape.match(name)))
    if not numbered:
        raise BagError(f'{where}: no column {selection} for {what}; it has '
                       f'{shown_names(columns, _MAX_NAMES)}')
    numbers = [number for number, _ in numbered]
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise BagError(f'{where}: columns {selection} for {what} are numbered '
                       f'{", ".join(map(str, numbers))}; a number is missing or repeats')
    return [k for _, k in numbered]


def _shape(selection: str) -> re.Pattern[str]:
    return re.compile(re.escape(selection).replace(re.escape('{i}'), r'(\d+)', 1) + r'$')


def _item(columns: Sequence[str], item: str, what: str, where: str) -> list[int]:
    if item in columns:
        return [columns.index(item)]
    span = _RANGE.match(item)
    first, last = (int(span[1]), int(span[2])) if span else (0, 0)
    if item.isdecimal():
        first = last = int(item)
    if not 1 <= first <= last <= len(columns):
        raise BagError(f'{where}: no column {item!r} for {what}; it has '
                       f'{shown_names(columns, _MAX_NAMES)}')
    return list(range(first - 1, last))
