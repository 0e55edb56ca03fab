"""
Layouts of tables as tools write them, brought to one, and the choice of columns.

The name of a column has a word for the quantity and a joint or its number, and may have a topic:
`/joint_states/elbow/position` (PlotJuggler), `elbow.pos`, `elbow_torque`, `position_elbow`, `q_1`,
`position[0]`, `field.position0` (rostopic). Also read are:

- `ros2 topic echo --csv`: no header; seconds, nanoseconds, frame, names, then numbers.
- numbered columns of the names of joints (rostopic, bagpy, Foxglove).
- seconds and nanoseconds in two columns.
- PlotJuggler: one message in several rows, rows of other topics, blank cells between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
import re

from gravity_comp_ros.data.differentiation import is_inconsistent, slope_ratios
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.printable import shown_names
from gravity_comp_ros.recordings.table_files import Table
from gravity_comp_ros.recordings.units import TIME_UNITS
import numpy as np

NONE = 'none'
# Column of time that is made of seconds and nanoseconds.
_JOINED_TIME = '__time'
_TIMES = ('t', 'time', 'timestamp', 'stamp')
# Units of columns of time whose names have one; that of rostopic is in ns.
NAMED_UNITS = {'%time': 'ns', **{f'{name}_{unit}': unit for name in _TIMES for unit in TIME_UNITS}}
# Words for each quantity, the preferred ones first.
_WORDS = {'position': ('q', 'position', 'pos'), 'velocity': ('qd', 'dq', 'velocity', 'vel'),
          'effort': ('tau', 'effort', 'torque', 'eff', 'load', 'current'), 'name': ('name',)}
# Numbers that may be no torque; without a name of the joint, the columns have to be given.
_NO_TORQUE = ('load', 'current')
_WORD = '|'.join(word for words in _WORDS.values() for word in words)
_SHAPES = tuple(re.compile(shape, re.I) for shape in (
    rf'(?:(?P<topic>.*)/)?(?P<joint>[^/]+)[/._](?P<word>{_WORD})$',
    rf'(?:(?P<topic>.*)[./])?(?P<word>{_WORD})s?[_.\[]?(?P<joint>\d+)\]?$',
    rf'(?:(?P<topic>.*)/)?(?P<word>{_WORD})_(?P<joint>[^/]+)$'))
_MAX_NAMES = 30

_SECONDS = re.compile(r'(.*?)(secs?|seconds)$', re.I)
_NANOSECONDS = ('nanosec', 'nanosecs', 'nanoseconds', 'nsec', 'nsecs')
_RANGE = re.compile(r'(\d+)-(\d+)$')

# Columns by word, and by joint or its number.
_Words = dict[str, dict[str, int]]


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


def known_layout(table: Table) -> Table:
    """Return the table with names of columns and one column of time."""
    return _with_one_time(_of_topic_echo(table))


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


def _with_one_time(table: Table) -> Table:
    """Append the sum of seconds and nanoseconds, if they are in two columns."""
    lower = [name.lower() for name in table.columns]
    for k, name in enumerate(lower):
        match = _SECONDS.match(name)
        partner = next((lower.index(match[1] + word) for word in _NANOSECONDS
                        if match and match[1] + word in lower), None)
        if match and partner is not None and partner != k and _JOINED_TIME not in lower:
            time = table.values[:, k] + 1e-9 * table.values[:, partner]
            return replace(table, columns=(*table.columns, _JOINED_TIME),
                           values=np.column_stack([table.values, time]))
    return table


def choose_columns(table: Table, position: str | None, velocity: str | None, effort: str | None,
                   time: str | None) -> Columns:
    """
    Return the columns of a table.

    Each argument selects columns, see `find_columns`; None searches for known names. `time` and
    `velocity` may be 'none'.

    :raises BagError: if columns are missing, used twice, or of several topics.
    """
    where, topics = str(table.path), _by_topic(table.columns)
    if position is None and effort is None:
        topics = _one_topic(topics, where)
    joints = _joints_of(topics) if position is None and effort is None else ()

    def find(what: str, selection: str | None) -> list[int]:
        if selection is not None:
            return find_columns(table.columns, selection, what, where)
        for words in topics.values():
            for word in _WORDS[what]:
                columns = words.get(word, {})
                if joints and all(joint in columns for joint in joints):
                    return [columns[joint] for joint in joints]
                numbered = [(int(joint), k) for joint, k in columns.items() if joint.isdecimal()]
                if numbered and not joints:
                    return _in_order(numbered, f'{word}_{{i}}', what, where)
        if what == 'velocity':
            return []
        raise BagError(f'{where}: no columns of {what} such as {_WORDS[what][0]}_1 or '
                       f'elbow/{what}; name them (--{what}); it has '
                       f'{", ".join(table.columns[:_MAX_NAMES])}')

    columns = Columns(find('position', position),
                      [] if velocity == NONE else find('velocity', velocity),
                      find('effort', effort), joints or _joint_names(table, topics),
                      _time(table, time))
    for what, indices in (('velocity', columns.velocity), ('effort', columns.effort)):
        if indices and len(indices) != len(columns.position):
            raise BagError(f'{where}: {len(columns.position)} columns of position but '
                           f'{len(indices)} of {what}')
    twice = sorted({table.columns[k] for k in columns.used if columns.used.count(k) > 1})
    if twice:
        raise BagError(f'{where}: column {", ".join(twice)} is used twice; position, '
                       f'velocity, effort and time require separate columns')
    return columns


def _by_topic(columns: Sequence[str]) -> dict[str, _Words]:
    """Return the columns with known names of each topic."""
    topics: dict[str, _Words] = {}
    for k, name in enumerate(columns):
        match = next(filter(None, (shape.match(name) for shape in _SHAPES)), None)
        if match and not (match['joint'].isdecimal() and match['word'].lower() in _NO_TORQUE):
            words = topics.setdefault(match['topic'] or '', {})
            words.setdefault(match['word'].lower(), {}).setdefault(match['joint'], k)
    return topics


def _one_topic(topics: dict[str, _Words], where: str) -> dict[str, _Words]:
    """Return the only topic, or /joint_states, with position and effort of a joint."""
    names = [topic for topic, words in topics.items() if any(_pairs(words))]
    if '/joint_states' in names:
        names = ['/joint_states']
    if len(names) > 1:
        raise BagError(f'{where} has joints of several topics, {", ".join(sorted(names))}; name '
                       f'the columns (--position, --effort)')
    return {topic: topics[topic] for topic in names} or topics


def _pairs(words: _Words) -> Iterator[list[str]]:
    """Yield the joints with both of a word of position and one of effort, preferred ones first."""
    for position, effort in product(_WORDS['position'], _WORDS['effort']):
        yield [joint for joint in words.get(position, ()) if joint in words.get(effort, ())]


def _joints_of(topics: dict[str, _Words]) -> tuple[str, ...]:
    """Return the names of joints with position and effort; none if their columns are numbered."""
    pairs = [joints for words in topics.values() for joints in _pairs(words) if joints]
    is_numbered = any(joint.isdecimal() for joints in pairs for joint in joints)
    return () if is_numbered or not pairs else tuple(pairs[0])


def _joint_names(table: Table, topics: dict[str, _Words]) -> tuple[str, ...] | None:
    """
    Return the names in numbered columns of text, None without such columns.

    :raises BagError: if a name changes.
    """
    names = next((words['name'] for words in topics.values() if 'name' in words), {})
    columns = [names[number] for number in sorted(filter(str.isdecimal, names), key=int)]
    if not columns or any(k not in table.text for k in columns):
        return None
    for k in columns:
        (_, first), *others = table.text[k]
        for line, cell in others:
            raise BagError(
                f'{table.path}, line {line}, column {table.columns[k]}: the joint is {cell!r} '
                f'after {first!r}; two publishers or another order of joints: write one file '
                f'for each')
    return tuple(table.text[k][0][1].strip() for k in columns)


def _time(table: Table, selection: str | None) -> int | None:
    if selection == NONE:
        return None
    if selection is not None:
        columns = find_columns(table.columns, selection, 'time', str(table.path))
        if len(columns) > 1:
            raise BagError(f'{table.path}: several columns of time')
        return columns[0]
    lower = [name.lower() for name in table.columns]
    return next((lower.index(name) for name in (*_TIMES, _JOINED_TIME, *NAMED_UNITS)
                 if name in lower), None)


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
        shape = re.compile(re.escape(selection).replace(re.escape('{i}'), r'(\d+)', 1) + '$')
        numbered = [(int(match[1]), k) for k, name in enumerate(columns)
                    if (match := shape.match(name))]
        if not numbered:
            raise BagError(f'{where}: no column {selection} for {what}; it has '
                           f'{shown_names(columns, _MAX_NAMES)}')
        return _in_order(numbered, selection, what, where)
    selected: list[int] = []
    for item in (part.strip() for part in selection.split(',')):
        selected += _item(columns, item, what, where)
    repeated = sorted({columns[k] for k in selected if selected.count(k) > 1})
    if repeated:
        raise BagError(f'{where}: column {", ".join(repeated)} is given twice for {what}')
    return selected


def _in_order(numbered: list[tuple[int, int]], selection: str, what: str, where: str
              ) -> list[int]:
    """Return the columns of numbers and columns in the order of the numbers."""
    numbers = [number for number, _ in sorted(numbered)]
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        raise BagError(f'{where}: columns {selection} for {what} are numbered '
                       f'{", ".join(map(str, numbers))}; a number is missing or repeats')
    return [k for _, k in sorted(numbered)]


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


def merged_rows(table: Table, columns: Columns) -> Table:
    """
    Return the table with the rows of one time as one, and without rows of other topics.

    Those are blank in the used columns. Rows with two values of a cell are not merged.
    """
    if columns.time is None or any(column in table.text for column in columns.used):
        return table
    # A row without a time is invalid, not blank.
    has_value = ~np.isnan(table.values[:, columns.used])
    table = table.part(np.isnan(table.values[:, columns.time]) | (has_value.sum(axis=1) > 1))
    values = table.values[:, columns.used]
    time = np.where(np.isfinite(values[:, -1]), values[:, -1], np.nan)
    is_new = ~(np.abs(np.diff(time, prepend=-np.inf)) <= FACTS.same_time)
    first = 0
    for k in np.flatnonzero(~is_new).tolist():
        first = k - 1 if is_new[k - 1] else first
        # The last column is the time.
        differs = (values[k] != values[first]) & ~np.isnan(values[k]) & ~np.isnan(values[first])
        if differs[:-1].any() or time[k] - time[first] > FACTS.same_time:
            is_new[k] = True
        else:
            values[first] = np.where(np.isnan(values[first]), values[k], values[first])
    merged = table.part(is_new)
    merged.values[:, columns.used] = values[is_new]
    return merged
