"""
Tables of numbers with named columns from CSV and Parquet files, and LeRobot data sets.

A LeRobot data set (needs pyarrow) has `meta/info.json` with the names of the joints, and
`data/**/*.parquet` with columns of lists: `observation.state`, and `observation.effort` or names
such as `elbow.load` if torques were recorded. Each episode begins at time 0.
"""

from __future__ import annotations

from array import array
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator, Mapping
import csv
from dataclasses import dataclass, field, replace
from datetime import datetime, time, UTC
from itertools import chain
import json
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.errors import BagError
import numpy as np


@dataclass(frozen=True, eq=False)
class Table:
    """
    A table of M rows and C columns, unconverted.

    `columns`: C unique names. `values` (M, C): NaN for an empty cell or text. `lines` (M,): line
    numbers of the rows in a text file. `text`: line and content of the first cell of text, and of
    the first that differs, by column.
    """

    path: Path
    columns: tuple[str, ...]
    values: FloatArray
    lines: array | IntArray | None = None
    text: Mapping[int, list[tuple[int, str]]] = field(default_factory=dict)

    def where(self, row: int) -> str:
        """Return the location of a row for messages: its number, and its line in a text file."""
        line = '' if self.lines is None else f' (line {self.lines[row]})'
        return f'{self.path}, row {row + 1}{line}'

    def part(self, rows: BoolArray | IntArray) -> Table:
        """Return the table with some of its rows."""
        lines = None if self.lines is None else np.asarray(self.lines)[rows]
        return replace(self, values=self.values[rows], lines=lines)


def read_csv(path: Path, header: bool | None = None, delimiter: str | None = None,
             skip_bad_rows: bool = False) -> Table:
    """
    Read the table in a text file.

    :param header: whether the first line has column names; None detects it. Without names, the
        columns are named 1, 2, 3.
    :param delimiter: one character; None detects semicolon, |, tab, comma or blank. With another
        delimiter than the comma, numbers may have a decimal comma.
    :param skip_bad_rows: replace incomplete rows by NaN.
    :raises BagError: if the file is not a table; the message names row and column.
    """
    try:
        with path.open('rb') as raw:
            is_utf16 = raw.read(2) in (BOM_UTF16_LE, BOM_UTF16_BE)
        with path.open(encoding='utf-16' if is_utf16 else 'utf-8-sig', newline='') as stream:
            head, skipped, marked = _head(stream)
            delimiter = marked or delimiter or _delimiter(head[0])
            rows = _rows(path, chain(head, stream), skipped, delimiter)
            return _csv_table(path, rows, delimiter != ',', header, skip_bad_rows)
    except UnicodeError:
        raise BagError(f'{path} is not a text file in UTF-8 or UTF-16: save it as UTF-8 (a '
                       f'recording needs no conversion)') from None
    except OSError as error:
        raise BagError(f'cannot read {path}: {error.strerror}') from None


def _head(stream: Iterator[str]) -> tuple[list[str], int, str]:
    """
    Return the first lines of the table, the number of lines before, and a delimiter named there.

    Before a table may be comments (#), and the `sep=;` of Excel. The last comment is the header
    if it has as many cells as the first line of numbers (numpy.savetxt).
    """
    before, line = list[str](), next(stream, '')
    while line.startswith(('#', 'sep=')):
        before.append(line.removeprefix('#'))
        line = next(stream, '')
    marked = next((each[4:].rstrip('\r\n') for each in before if each.startswith('sep=')), '')
    head = [line]
    if before and not before[-1].startswith('sep='):
        delimiter = marked or _delimiter(before[-1])
        first, second = (next(_rows(Path(), iter([each]), 0, delimiter), (0, ['']))[1]
                         for each in (before[-1], line))
        if len(first) == len(second) and _number(second[0], delimiter != ',') is not None:
            head.insert(0, before.pop())
    return head, len(before), marked


def _csv_table(path: Path, rows: Iterator[tuple[int, list[str]]], decimal_comma: bool,
               header: bool | None, skip_bad_rows: bool) -> Table:
    """Return the table of rows of text cells; empty cells and text become NaN."""
    first = next(rows, None)
    if first is None:
        raise BagError(f'{path} is empty')
    if header is None:
        header = all(_number(cell, decimal_comma) is None for cell in first[1])
    names = [cell.strip() for cell in first[1]] if header else [
        str(k + 1) for k in range(len(first[1]))]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise BagError(f'{path}: columns repeat: {", ".join(repeated)}')
    values, lines = array('d'), array('q')
    text: dict[int, list[tuple[int, str]]] = {}
    for line, cells in rows if header else chain([first], rows):
        if len(cells) == len(names) + 1 and not cells[-1].strip():
            cells = cells[:-1]  # a delimiter ends the line
        if len(cells) != len(names) and not skip_bad_rows:
            raise BagError(f'{path}, line {line}: {len(cells)} cells; the table has '
                           f'{len(names)} columns (--skip-bad-rows skips such rows)')
        if len(cells) != len(names):
            cells = [''] * len(names)
        for column, cell in enumerate(cells):
            number = _number(cell, decimal_comma)
            values.append(np.nan if number is None else number)
            # Text is an error only in a used column.
            if number is None and cell.strip():
                seen = text.setdefault(column, [])
                if not seen or len(seen) == 1 and seen[0][1] != cell:
                    seen.append((line, cell))
        lines.append(line)
    if not lines:
        raise BagError(f'{path} has no rows')
    return Table(path, tuple(names), np.frombuffer(values).reshape(-1, len(names)).copy(), lines,
                 text)


def _rows(path: Path, stream: Iterator[str], skipped: int, delimiter: str
          ) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each line that is not blank, after skipped lines."""
    reader = csv.reader(stream, delimiter=delimiter, skipinitialspace=True)
    try:
        for cells in reader:
            if delimiter == ' ':
                cells = [cell for cell in cells if cell]
            if cells:
                yield skipped + reader.line_num, cells
    except csv.Error as error:
        raise BagError(f'{path}, line {skipped + reader.line_num}: {error}') from None


def _delimiter(line: str) -> str:
    """Return the delimiter of a line; with semicolons, tabs or blanks, commas are decimal."""
    delimiter = next((character for character in ';|\t,' if character in line), ' ')
    words = line.split()
    if delimiter == ',' and len(words) > 1 and all(
            _number(word, True) is not None and not word.endswith(',') for word in words):
        return ' '
    return delimiter


def _number(cell: str, decimal_comma: bool) -> float | None:
    """
    Return the number in a cell, None for text and an empty cell.

    A date with a time of day gives s since 1970, by default in UTC; a time of day s since 0:00.
    """
    try:
        return float(cell.replace(',', '.') if decimal_comma and '.' not in cell else cell)
    except ValueError:
        if ':' not in cell:
            return None
    try:
        date = datetime.fromisoformat(cell.strip())
    except ValueError:
        try:
            date = datetime.combine(datetime(1970, 1, 1), time.fromisoformat(cell.strip()))
        except ValueError:
            return None
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


_INFO = Path('meta') / 'info.json'
# Prefixes of the names of joints, by the last word of a column of lists.
_WHAT = {'state': 'position', 'position': 'position', 'velocity': 'velocity',
         'effort': 'effort', 'torque': 'effort', 'current': 'effort'}
_SUFFIXES = ('.pos', '.vel', '.load', '.eff', '.effort', '.torque', '.current', '.position',
             '.velocity')
# Pause between episodes, s: their distance in time is not recorded.
_PAUSE = 60.0


def is_parquet(path: Path) -> bool:
    """Return whether the path is a Parquet file, or the folder of a LeRobot data set."""
    return path.suffix.lower() == '.parquet' or (path.is_dir() and (path / _INFO).exists())


def read_parquet(path: Path) -> Table:
    """
    Return the table of a Parquet file, or of all files of a LeRobot data set.

    :raises BagError: if pyarrow is missing, or a file cannot be read.
    """
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise BagError(f'{path}: Parquet files need pyarrow (pip install pyarrow)') from None
    files = sorted((path / 'data').rglob('*.parquet')) if path.is_dir() else [path]
    if not files:
        raise BagError(f'{path} has no Parquet files in its folder data')
    try:
        tables = [parquet.read_table(file) for file in files]
    except (OSError, ValueError, ArrowException) as error:
        raise BagError(f'{path} cannot be read as Parquet: '
                       f'{" ".join(str(error).split())}') from None
    names = _joint_names(path)
    parts = [_parquet_columns(table, names) for table in tables]
    columns = tuple(parts[0])
    if any(tuple(part) != columns for part in parts):
        raise BagError(f'{path}: its files have different columns')
    if not columns:
        raise BagError(f'{path} has no columns of numbers')
    values = np.concatenate([np.column_stack(list(part.values())) for part in parts])
    if {'timestamp', 'episode_index'} <= set(columns):
        time, episode = columns.index('timestamp'), columns.index('episode_index')
        values[:, time] = _one_after_another(values[:, time], values[:, episode])
    return Table(path, columns, values)


def _parquet_columns(table: Any, names: dict[str, list[str]]) -> dict[str, FloatArray]:
    """
    Return the columns of numbers by name; lists are expanded, but those of actions.

    Dates and durations are in s, as those of text files.
    """
    def expanded(key: str, count: int) -> list[str]:
        known, what = names.get(key, []), _WHAT.get(key.rsplit('.', 1)[-1], key)
        if len(known) != count:
            return [f'{what}_{k + 1}' for k in range(count)]
        return known if all(name.endswith(_SUFFIXES) for name in known) else [
            f'{what}_{name}' for name in known]

    arrays: dict[str, FloatArray] = {}
    for key in table.column_names:
        values: Any = table[key].to_numpy() if len(table) else np.empty(0)
        if values.dtype == object:
            try:
                rows = [np.asarray(each, dtype=np.float64) for each in values]
                # A missing list is a number that is not known.
                shape = max(row.shape for row in rows)
                values = np.stack([row if row.ndim else np.broadcast_to(row, shape)
                                   for row in rows])
            except (ValueError, TypeError):
                continue
        if values.dtype.kind in 'mM':
            seconds = values.astype(f'{values.dtype.kind}8[ns]').astype(np.int64) / 1e9
            values = np.where(np.isnat(values), np.nan, seconds)
        if values.dtype.kind not in 'fiu':
            continue
        if values.ndim == 1:
            arrays[key] = values.astype(np.float64)
        elif values.ndim == 2 and not key.startswith('action'):
            arrays |= zip(expanded(key, values.shape[1]), values.T)
    return arrays


def _joint_names(path: Path) -> dict[str, list[str]]:
    """Return the names of the entries of each column of lists, from the info file."""
    folder = next((each for each in (path, *path.resolve().parents) if (each / _INFO).exists()),
                  None)
    if folder is None:
        return {}
    try:
        features = json.loads((folder / _INFO).read_text(encoding='utf-8'))['features']
        return {key: _flat(feature['names']) for key, feature in features.items()
                if feature.get('names')}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BagError(f'{folder / _INFO} is not the information of a LeRobot data set: '
                       f'{" ".join(str(error).split())}') from None


def _flat(names: Any) -> list[str]:
    """Return names that are a list, or lists by group as in {"motors": [...]}."""
    if isinstance(names, dict):
        return [name for group in names.values() for name in _flat(group)]
    return [str(name) for name in names] if isinstance(names, list) else []


def _one_after_another(t: FloatArray, episode: FloatArray) -> FloatArray:
    """Return times (M,) in which each episode begins a pause after the last one."""
    out, end = t.copy(), None
    for number in np.unique(episode):
        rows = episode == number
        if end is not None:
            out[rows] += end + _PAUSE - t[rows].min()
        end = out[rows].max()
    return out
