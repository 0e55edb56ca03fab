"""Folder layout of a fleet: one subfolder per robot, with the bags of that robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.storage import data_files

_SUFFIXES = ('.mcap', '.db3', '.mcap.zstd', '.db3.zstd')


@dataclass(frozen=True)
class Robot:
    """A robot, named after its folder, and its bags sorted by name."""

    name: str
    bags: tuple[Path, ...]


def find_robots(folder: Path) -> list[Robot]:
    """
    Return the robots of a fleet, sorted by name.

    Each subfolder is a robot, unless it is a rosbag2 folder. Bags directly in `folder` belong to
    one robot with the name of the folder.

    :raises BagError: if the folder does not exist or contains no bag.
    """
    try:
        entries = sorted(path for path in folder.iterdir() if not path.name.startswith('.'))
    except OSError as error:
        raise BagError(f'cannot read the fleet {folder}: {error.strerror}') from None
    robots = [Robot(path.name, _bags(path)) for path in entries
              if path.is_dir() and not _is_bag(path)]
    robots.append(Robot(folder.resolve().name, _bags(folder)))
    robots = sorted((robot for robot in robots if robot.bags), key=lambda robot: robot.name)
    if not robots:
        raise BagError(f'{folder} contains no recording: put the bags of each robot into a '
                       f'subfolder with its name')
    names = [robot.name for robot in robots]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BagError(f'two robots are named {twice[0]}: {folder} has bags of its own and a '
                       f'subfolder of the same name')
    return robots


def state_of(path: Path) -> list[tuple[str, int, int]]:
    """Return name, size and time of change in ns of the files of a bag, or of a file."""
    try:
        return [(str(file), file.stat().st_size, file.stat().st_mtime_ns)
                for file in data_files(path)]
    except (BagError, OSError) as error:
        return [(f'{path}: {error}', 0, 0)]


def _bags(folder: Path) -> tuple[Path, ...]:
    try:
        return tuple(sorted(path for path in folder.iterdir() if _is_bag(path)))
    except OSError:
        return ()


def _is_bag(path: Path) -> bool:
    if path.is_file():
        return path.name.endswith(_SUFFIXES)
    return (path / 'metadata.yaml').is_file()
