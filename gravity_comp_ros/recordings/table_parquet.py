"""
Tables in Parquet files, and the data sets of LeRobot that consist of them (needs pyarrow).

A LeRobot data set has `meta/info.json` with the names of the joints, and `data/**/*.parquet` with
columns of lists: `observation.state`, and `observation.effort` or names such as `elbow.load` if
torques were recorded. Each episode begins at time 0.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.table_files import check_columns, Table
import numpy as np

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
    parts = [_columns(table, names) for table in tables]
    columns = tuple(parts[0])
    if any(tuple(part) != columns for part in parts):
        raise BagError(f'{path}: its files have different columns')
    if not columns:
        raise BagError(f'{path} has no columns of numbers')
    check_columns(path, list(columns))
    values = np.concatenate([np.column_stack(list(part.values())) for part in parts])
    if {'timestamp', 'episode_index'} <= set(columns):
        time, episode = columns.index('timestamp'), columns.index('episode_index')
        values[:, time] = _one_after_another(values[:, time], values[:, episode])
    return Table(path, columns, values)


def _columns(table: Any, names: dict[str, list[str]]) -> dict[str, FloatArray]:
    """Return the columns of numbers by name; lists are expanded."""
    arrays: dict[str, FloatArray] = {}
    for key in table.column_names:
        values: Any = table[key].to_numpy() if len(table) else np.empty(0)
        if values.dtype == object:
            try:
                values = np.stack([np.asarray(each, dtype=np.float64) for each in values])
            except (ValueError, TypeError):
                continue
        if values.dtype.kind not in 'fiu' or values.ndim not in (1, 2):
            continue
        values = values.astype(np.float64)
        if values.ndim == 1:
            arrays[key] = values
            continue
        if key.startswith('action'):
            continue
        arrays |= dict(zip(_expanded(key, names.get(key), values.shape[1]), values.T))
    return arrays


def _expanded(key: str, names: list[str] | None, count: int) -> list[str]:
    what = _WHAT.get(key.rsplit('.', 1)[-1], key)
    if names is None or len(names) != count:
        return [f'{what}_{k + 1}' for k in range(count)]
    if all(name.endswith(_SUFFIXES) for name in names):
        return names
    return [f'{what}_{name}' for name in names]


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
