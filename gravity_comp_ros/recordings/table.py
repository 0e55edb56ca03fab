"""Conversion of tables of measurements, in any units, to joint states."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.errors import BagError, OptionError
from gravity_comp_ros.recordings.mcap_writer import DEFAULT_START_NS, JointTopic
from gravity_comp_ros.recordings.table_columns import (
    choose_columns, Columns, known_layout, merged_rows, NAMED_UNITS, NONE)
from gravity_comp_ros.recordings.table_files import (
    is_parquet, read_csv, read_parquet, Table)
from gravity_comp_ros.recordings.table_units import (
    check_angles, check_seconds, check_velocity, decoded)
from gravity_comp_ros.recordings.units import (
    check_effort_unit, CURRENT_UNITS, EFFORT_UNITS, is_ticks, radians_per_unit, TIME_UNITS)
import numpy as np

NO_VELOCITY = 'no velocity in the table; it will be differentiated from the position'


@dataclass(frozen=True)
class TableOptions:
    """
    Meaning of the columns of a table.

    - `time`, `position`, `velocity`, `effort`: columns, see `table_columns.find_columns`; None
      searches for known names. `velocity` 'none' ignores velocities.
    - `rate`: sample rate in Hz, required without a time column; `time` 'none' ignores the column.
    - `time_unit`, `position_unit`: None assumes s and rad, and refuses implausible values.
      Counts of encoders (`ticks=N`) may be registers with a sign bit.
    - `effort_sign`, `torque_constant` (N·m/A at the motor), `gear_ratio`: one value for all
      joints or one per joint; the latter two apply to currents.
    - `rated_torque`: N·m of the joint at 100 %, for efforts in per cent or per mille of it.
    - `joints`: joint names; None takes them from the file.
    - `header`: whether the first line has column names; None detects it.
    - `delimiter`: one character; None detects it.
    - `skip_bad_rows`: drop rows that are incomplete, have a cell that is not a finite number, or
      a time that does not increase; otherwise the file is refused.

    :raises OptionError: if a value is invalid, or a current has no torque constant.
    """

    time: str | None = None
    position: str | None = None
    velocity: str | None = None
    effort: str | None = None
    rate: float | None = None
    time_unit: str | None = None
    position_unit: str | None = None
    effort_unit: str = 'Nm'
    effort_sign: tuple[float, ...] = (1.0,)
    torque_constant: tuple[float, ...] | None = None
    rated_torque: tuple[float, ...] | None = None
    gear_ratio: tuple[float, ...] = (1.0,)
    joints: tuple[str, ...] | None = None
    header: bool | None = None
    delimiter: str | None = None
    skip_bad_rows: bool = False

    def __post_init__(self) -> None:
        if (self.time_unit or 's') not in TIME_UNITS:
            raise OptionError(f'time unit {self.time_unit!r} is not one of '
                              f'{", ".join(TIME_UNITS)}')
        check_effort_unit(self.effort_unit, EFFORT_UNITS, self.rated_torque is not None)
        radians_per_unit(self.position_unit or 'rad')
        if self.rate is not None and not (np.isfinite(self.rate) and self.rate > 0):
            raise OptionError(f'rate is {self.rate} Hz; it must be positive')
        if self.rate is not None and self.time not in (None, NONE):
            raise OptionError('give a time column or a fixed rate, not both')
        if any(sign not in (-1.0, 1.0) for sign in self.effort_sign):
            raise OptionError('effort signs are 1 or -1')
        is_current = self.effort_unit in CURRENT_UNITS
        if is_current != (self.torque_constant is not None):
            raise OptionError('effort in A or mA needs a torque constant in N·m/A'
                              if is_current else 'a torque constant is for effort in A or mA')
        for what, values in (('torque constant', self.torque_constant or (1.0,)),
                             ('rated torque', self.rated_torque or (1.0,)),
                             ('gear ratio', self.gear_ratio)):
            if not all(np.isfinite(value) and value != 0 for value in values):
                raise OptionError(f'{what} must be finite and not 0')
        if self.delimiter is not None and len(self.delimiter) != 1:
            raise OptionError(f'delimiter {self.delimiter!r} is not one character')


@dataclass(frozen=True)
class Converted:
    """Joint states from a table, start time, number of dropped rows, and notes."""

    topic: JointTopic
    start_ns: int
    dropped: int
    notes: tuple[str, ...]


def read_table(path: str | Path, options: TableOptions = TableOptions(),
               topic: str = '/joint_states') -> Converted:
    """
    Return the joint states in a CSV or Parquet file, in rad, rad/s and N·m.

    :raises BagError: if the file cannot be read, a column is missing, or a cell is invalid; the
        message names the row and the column.
    :raises OptionError: if the number of signs or constants is not the number of joints.
    """
    path = Path(path)
    if is_parquet(path):
        table = read_parquet(path)
    else:
        table = read_csv(path, options.header, options.delimiter, options.skip_bad_rows)
    table = known_layout(table)
    columns = choose_columns(table, options.position, options.velocity, options.effort,
                             options.time)
    if options.rate is not None and columns.time is not None:
        raise OptionError(f'{path} has a column of time, {table.columns[columns.time]}: omit '
                          f'--rate, or ignore the column with --time {NONE}')
    if options.rate is None and columns.time is None:
        raise BagError(f'{path} has no column of time; name it (--time), or give a fixed '
                       f'rate (--rate)')
    rows_read = len(table.values)
    table = merged_rows(table, columns)
    merged = rows_read - len(table.values)
    names = _joint_names(table, options, columns.joints, len(columns.position))
    keep = _usable_rows(table, columns, options)
    rows = table.values[keep]
    notes = [NO_VELOCITY] * (not columns.velocity)
    if merged:
        notes.append(f'{merged} of {rows_read} rows are joined with another row of their time, or '
                     f'are of other topics')
    angle = radians_per_unit(options.position_unit or 'rad')
    position, velocity = rows[:, columns.position], rows[:, columns.velocity]
    effort = rows[:, columns.effort]
    if is_ticks(options.position_unit):
        (position, one), (velocity, two), (effort, three) = map(decoded, (
            position, velocity, effort))
        notes += [f'{what} is read as registers with {encoding}' for what, encoding in (
            ('position', one), ('velocity', two), ('effort', three)) if encoding]
    q, qd = position * angle, velocity * angle if columns.velocity else None
    tau = effort * _effort_scale(options, names)
    if not tau.any():
        raise BagError(f'{path}: effort is 0 throughout, for every joint')
    if columns.time is None:
        # Skipped rows do not shift the time of later rows.
        t: FloatArray = np.flatnonzero(keep) / float(options.rate or 1.0)
    else:
        named_unit = NAMED_UNITS.get(table.columns[columns.time].lower())
        t = rows[:, columns.time] * TIME_UNITS[options.time_unit or named_unit or 's']
    if options.position_unit is None:
        check_angles(path, names, t, q)
    if qd is not None:
        check_velocity(path, t, q, qd, options.time_unit is not None or columns.time is None)
    if columns.time is not None and (options.time_unit or named_unit) is None:
        check_seconds(path, t, q)
    start = t[0]
    start_ns = int(start * 1e9) if 1e9 <= start < 2**31 else DEFAULT_START_NS
    return Converted(JointTopic(topic, names, t - start, q, qd, tau), start_ns,
                     int(keep.size - keep.sum()), tuple(notes))


def _joint_names(table: Table, options: TableOptions, named: tuple[str, ...] | None,
                 count: int) -> tuple[str, ...]:
    names = options.joints or named or tuple(
        f'joint_{k + 1}' for k in range(count))
    if len(names) != count:
        raise OptionError(f'{len(names)} joint names for {count} columns of position in '
                          f'{table.path}')
    if len(set(names)) < count or not all(names):
        raise OptionError(f'joint names of {table.path} repeat or are empty: {", ".join(names)}')
    return names


def _usable_rows(table: Table, columns: Columns, options: TableOptions) -> BoolArray:
    """Return the mask of valid rows; refuse invalid ones unless they may be skipped."""
    used = columns.used
    bad = ~np.isfinite(table.values[:, used])
    keep = np.asarray(~bad.any(axis=1), dtype=bool)
    never = bad.all(axis=0)
    if not keep.all() and (never.any() or not options.skip_bad_rows):
        row, column = (0, np.argmax(never)) if never.any() else np.argwhere(bad)[0]
        advice = ('; no row has a number in this column' if never.any() else
                  ' (--skip-bad-rows skips such rows)')
        raise BagError(f'{table.where(int(row))}, column {table.columns[used[column]]}: '
                       f'{_defect(table, int(row), used[column])}{advice}')
    if columns.time is not None:
        time = np.where(keep, table.values[:, columns.time], -np.inf)
        latest = np.append(-np.inf, np.maximum.accumulate(time)[:-1])
        back = keep & (time <= latest)
        if back.any() and not options.skip_bad_rows:
            row = int(np.argmax(back))
            raise BagError(f'{table.where(row)}: time does not increase ({time[row]:.9g} after '
                           f'{latest[row]:.9g}; --skip-bad-rows drops such rows)')
        keep &= ~back
    if not keep.any():
        raise BagError(f'{table.path} has no usable row')
    return keep


def _defect(table: Table, row: int, column: int) -> str:
    """Return why the cell of a row, the first invalid one of its column, is not a number."""
    if np.isinf(table.values[row, column]):
        return 'not finite'
    line, cell = table.text.get(column, [(0, '')])[0]
    if table.lines is None or line != table.lines[row]:
        return 'empty or not a number'
    advice = ''
    if ':' in cell:
        advice = '; a time is written as 10:30:00.5, with a date as 2024-12-31 10:30:00.5'
    elif ',' in cell:
        advice = '; for a decimal comma, separate the cells by semicolons, thousands by nothing'
    return f'{cell!r} is not a number{advice}'


def _effort_scale(options: TableOptions, names: tuple[str, ...]) -> FloatArray:
    """Return N·m per unit of effort, sign included, of each joint, (N,)."""
    scale = np.full(len(names), EFFORT_UNITS[options.effort_unit])
    for what, values in (('effort signs', options.effort_sign),
                         ('torque constants', options.torque_constant or (1.0,)),
                         ('rated torques', options.rated_torque or (1.0,)),
                         ('gear ratios', options.gear_ratio)):
        if len(values) not in (1, len(names)):
            raise OptionError(f'{len(values)} {what} for {len(names)} joints')
        scale = scale * np.asarray(values)
    return scale
