"""The bags of a fleet: a folder for each robot, the bags of that robot in it."""

from __future__ import annotations

from dataclasses import dataclass
import hashlib
from pathlib import Path

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.storage import data_files

_SUFFIXES = ('.mcap', '.db3', '.mcap.zstd', '.db3.zstd')


@dataclass(frozen=True)
class Robot:
    """A robot's name, which is that of its folder, and its bags in order of their names."""

    name: str
    bags: tuple[Path, ...]


def find_robots(folder: Path) -> list[Robot]:
    """
    Return the robots of a fleet, in order of their names.

    Each subfolder is a robot, unless it is itself a bag. Bags that lie in the folder itself are
    of one robot, which has the name of the folder.

    :raises BagError: if there is no such folder, or no bag in it.
    """
    try:
        inside = sorted(path for path in folder.iterdir() if not path.name.startswith('.'))
    except OSError as error:
        raise BagError(f'cannot read the fleet {folder}: {error.strerror}') from None
    robots = [Robot(path.name, _bags(path)) for path in inside
              if path.is_dir() and not _is_bag(path)]
    robots.append(Robot(folder.resolve().name, _bags(folder)))
    robots = sorted((robot for robot in robots if robot.bags), key=lambda robot: robot.name)
    if not robots:
        raise BagError(f'{folder} holds no recording: put the bags of each robot into a folder '
                       f'with its name')
    names = [robot.name for robot in robots]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BagError(f'{folder} has bags both in itself and in its folder {twice[0]}')
    return robots


def fingerprint_of(bag: Path, *settings: object) -> str:
    """
    Return what a result of this bag with these settings is known by.

    Names, sizes and times of the files stand for what is in them.
    """
    try:
        stats = [(file.name, file.stat().st_size, file.stat().st_mtime_ns)
                 for file in data_files(bag)]
    except (BagError, OSError) as error:
        stats = [(str(error), 0, 0)]
    return hashlib.sha256(repr((str(bag), stats, settings)).encode()).hexdigest()[:32]


def _bags(folder: Path) -> tuple[Path, ...]:
    try:
        return tuple(sorted(path for path in folder.iterdir() if _is_bag(path)))
    except OSError:
        return ()


def _is_bag(path: Path) -> bool:
    if path.is_file():
        return path.name.endswith(_SUFFIXES)
    return (path / 'metadata.yaml').is_file()
