"""
Layouts of tables as tools write them, brought to one, and the choice of columns.

The layout has named columns and one column of time. Read are:

- `ros2 topic echo --csv`: no header; seconds, nanoseconds, frame, names, then numbers.
- rostopic, bagpy, Foxglove: numbered columns such as `field.position0`, `position_0` or
  `position[0]`, and columns of the names with the same numbers.
- seconds and nanoseconds in two columns.
- PlotJuggler: one message in several rows, rows of other topics, blank cells between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import re

from gravity_comp_ros.data.differentiation import is_inconsistent, slope_ratios
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.printable import shown_names
from gravity_comp_ros.recordings.defects import DEFECTS
from gravity_comp_ros.recordings.table_files import Table
import numpy as np

# Column of time that is made of seconds and nanoseconds.
JOINED_TIME = '__time'
# Column of time of rostopic, in ns.
ROSTOPIC_TIME = '%time'

_SECONDS = re.compile(r'(.*?)(secs?|seconds)$', re.I)
_NANOSECONDS = ('nanosec', 'nanosecs', 'nanoseconds', 'nsec', 'nsecs')
_NUMBERED = re.compile(
    r'(?:.*[./])?(name|position|velocity|effort)s?[_.\[]?(\d+)\]?$', re.I)


def known_layout(table: Table) -> Table:
    """Return the table with names of columns, joint names and one column of time."""
    return _with_one_time(_with_numbers(_of_topic_echo(table)))


def _of_topic_echo(table: Table) -> Table:
    """Name the columns of `ros2 topic echo --csv` of a JointState."""
    if table.columns != tuple(str(k + 1) for k in range(len(table.columns))):
        return table
    count = 0
    while 3 + count in table.text:
        count += 1
    arrays, rest = divmod(len(table.columns) - 3 - count, max(count, 1))
    if not count or rest or arrays not in (2, 3) or 0 in table.text or 1 in table.text:
        return table
    what = ['position', 'velocity', 'effort']
    if arrays == 2:
        t = table.values[:, 0] + 1e-9 * table.values[:, 1]
        q, other = (table.values[:, 3 + (k + 1) * count:3 + (k + 2) * count] for k in range(2))
        is_speed = ~is_inconsistent(*slope_ratios(t, q, other)).any()
        what.remove('effort' if is_speed else 'velocity')
    names = ['sec', 'nanosec', 'frame_id'] + [
        f'{word}_{k}' for word in ('name', *what) for k in range(count)]
    return replace(table, columns=tuple(names))


def _with_numbers(table: Table) -> Table:
    """Name numbered columns `position_0`, and take joint names from the columns of names."""
    numbered = {k: match for k, name in enumerate(table.columns)
                if (match := _NUMBERED.match(name))}
    columns = [f'{numbered[k][1].lower()}_{numbered[k][2]}' if k in numbered else name
               for k, name in enumerate(table.columns)]
    if len(set(columns)) < len(columns):
        return table
    names = {int(match[2]): k for k, match in numbered.items() if match[1].lower() == 'name'}
    joints = table.joints
    if names and all(k in table.text for k in names.values()):
        joints = tuple(table.text[names[number]][0][1].strip() for number in sorted(names))
        for k in names.values():
            (_, first), *others = table.text[k]
            for line, cell in others:
                raise BagError(
                    f'{table.path}, line {line}, column {table.columns[k]}: the joint is {cell!r} '
                    f'after {first!r}; two publishers or another order of joints: write one file '
                    f'for each')
    return replace(table, columns=tuple(columns), joints=joints)


def _with_one_time(table: Table) -> Table:
    """Append the sum of seconds and nanoseconds, if they are in two columns."""
    lower = [name.lower() for name in table.columns]
    for k, name in enumerate(lower):
        match = _SECONDS.match(name)
        partner = next((lower.index(match[1] + word) for word in _NANOSECONDS
                        if match and match[1] + word in lower), None)
        if match and partner is not None and partner != k and JOINED_TIME not in lower:
            time = table.values[:, k] + 1e-9 * table.values[:, partner]
            return replace(table, columns=(*table.columns, JOINED_TIME),
                           values=np.column_stack([table.values, time]))
    return table


def merged_rows(table: Table, time: int, used: list[int]) -> Table:
    """
    Return the table without rows that are blank in the used columns, with rows of one time merged.

    :param time: column of time.
    :param used: all columns of position, velocity, effort and time.
    """
    values = table.values
    blank = np.isnan(values[:, [column for column in used if column != time]])
    if not blank.any() or any(column in table.text for column in used):
        return table
    # Rows without a time are invalid, not blank.
    rows = np.flatnonzero(~blank.all(axis=1) | np.isnan(values[:, time]))
    if not rows.size:
        return table
    starts = _groups(values[rows, time], blank[rows])
    merged = table.part(rows[starts])
    group = np.cumsum(np.isin(np.arange(len(rows)), starts)) - 1
    # Later rows first, so that the first value of a group remains.
    for column in used:
        here = np.isfinite(values[rows, column])
        merged.values[group[here][::-1], column] = values[rows[here], column][::-1]
    return merged


def _groups(t: FloatArray, blank: np.ndarray) -> np.ndarray:
    """Return the first row of each group of equal time without a value given twice."""
    starts, filled = [0], ~blank[0]
    for k in range(1, len(t)):
        present = ~blank[k]
        is_same = abs(t[k] - t[starts[-1]]) <= DEFECTS.same_time
        if not is_same or (filled & present).any():
            starts.append(k)
            filled = present
        else:
            filled = filled | present
    return np.array(starts)


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
