"""Fit or diagnosis of every robot of a folder; an interrupted run is resumed from a cache."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
import hashlib
import json
from pathlib import Path
from typing import Any

from gravity_comp_ros import __version__
from gravity_comp_ros.api.read import bounded, joined
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.api.steps import learn, LearnOptions, with_enough_motion
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.diagnosis.diagnose import diagnose, DiagnosisOptions
from gravity_comp_ros.errors import BagError, FitError, GravityCompError
from gravity_comp_ros.fleet.cluster import ClusterOptions, Failure, run_tasks
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
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


CACHE = '.fleet'  # subfolder of the output folder


@dataclass(frozen=True)
class FleetOptions:
    """
    Step of every robot, and its options.

    - `step`: 'fit' writes OUTPUT/ROBOT.json, 'diagnose' writes OUTPUT/ROBOT.diagnosis.json.
    - `reading`, `gate`, `learning`: as of `fit`.
    - `models`: folder with ROBOT.json to diagnose; None fits a model first.
    - `effects`: effects to diagnose; None for all.
    """

    step: str
    reading: ReadOptions = ReadOptions()
    gate: GateOptions | None = GateOptions()
    learning: LearnOptions = LearnOptions()
    models: Path | None = None
    effects: tuple[str, ...] | None = None


@dataclass(frozen=True)
class RobotResult:
    """
    Result of one robot: its entry in `fleet --json`, and the reasons of its unreadable bags.

    `model` is the fitted model; `diagnosis` has the form of `diagnose --json`.
    """

    entry: dict[str, Any]
    failed_bags: dict[str, str]
    model: GravityModel | None = None
    diagnosis: dict[str, Any] | None = None


@dataclass
class Outcome:
    """Entries of a fleet run by robot, reasons of failures, number of robots of earlier runs."""

    robots: dict[str, dict[str, Any]] = field(default_factory=dict)
    failed_bags: dict[str, str] = field(default_factory=dict)
    failed_robots: dict[str, str] = field(default_factory=dict)
    resumed: int = 0


def run_fleet(robots: Sequence[Robot], output: Path, options: FleetOptions,
              cluster: ClusterOptions = ClusterOptions(),
              progress: Progress = lambda step, fraction: None) -> Outcome:
    """
    Fit or diagnose every robot, each with all its readable bags.

    A result is stored in OUTPUT/.fleet under the version of this package, the files and the
    options. The same call goes on where an earlier one ended.

    :raises BagError: if a result cannot be written.
    :raises DataError: if the cluster cannot be reached.
    """
    _create(output / CACHE)
    outcome, pending, keys = Outcome(), [], {}
    for robot in robots:
        keys[robot] = _key(robot, options)
        stored = _stored(output, keys[robot])
        if stored is None:
            pending.append(robot)
        else:
            outcome.resumed += 1
            outcome.robots[robot.name] = stored['entry']
            outcome.failed_bags.update(stored['failed_bags'])
    task = partial(_result, options=options)
    for count, (number, result) in enumerate(run_tasks(cluster, task, pending) if pending else ()):
        robot = pending[number]
        progress(f'{options.step} {robot.name}', (count + 1) / len(pending))
        if isinstance(result, Failure):
            outcome.failed_robots[robot.name] = result.reason
            continue
        _save(output, keys[robot], robot, result)
        outcome.robots[robot.name] = result.entry
        outcome.failed_bags.update(result.failed_bags)
    return outcome


def _result(robot: Robot, options: FleetOptions) -> RobotResult:
    """
    Return the result of one robot; runs on a worker and writes no file.

    :raises FitError: if none of its bags can be read, or the fit fails.
    """
    if options.step == 'fit':
        recording, failed = _read(robot, options.reading, options.gate)
        learned = learn(with_enough_motion(recording), options.learning)
        problem = learned.arm.axes.problem
        result = learned.result.with_warning(problem) if problem else learned.result
        return RobotResult({
            'model': f'{robot.name}.json', 'bags': recording.n_runs,
            'samples': result.model.coverage.n_samples, 'converged': result.converged,
            'rmse': result.report.rmse, 'warnings': list(result.report.warnings)},
            failed, model=result.model)
    model = load_model(options.models / f'{robot.name}.json') if options.models else None
    reading = options.reading
    if model is not None and reading.joints is None:
        reading = replace(reading, joints=model.joints)
    recording, failed = _read(robot, reading, None)
    model = model or learn(replace(recording, gate=GateOptions()), options.learning).model
    document = diagnose(recording.samples, model,
                        DiagnosisOptions(effects=options.effects)).to_json()
    return RobotResult({'diagnosis': f'{robot.name}.diagnosis.json',
                        'findings': document['findings']}, failed, diagnosis=document)


def _read(robot: Robot, options: ReadOptions,
          gate: GateOptions | None) -> tuple[Recording, dict[str, str]]:
    """Return the readable bags of a robot as one recording, and the reasons of the others."""
    runs, failed, options = [], {}, bounded(options, len(robot.bags))
    for bag in robot.bags:
        try:
            runs.append(read_bag(bag, options))
            options = runs[-1].report.options
        except GravityCompError as error:
            failed[str(bag)] = str(error)
    if not runs:
        raise FitError(f'none of its bags could be read: {"; ".join(failed.values())}')
    return joined(runs, gate), failed


def _key(robot: Robot, options: FleetOptions) -> str:
    """Return the name of a result in the cache."""
    model = options.models and options.models / f'{robot.name}.json'
    parts = (__version__, asdict(options), robot.name,
             [state_of(file) for file in (*robot.bags, *([model] if model else []))])
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def _create(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BagError(f'cannot create the folder {folder}: {error.strerror}') from None


def _stored(output: Path, key: str) -> dict[str, Any] | None:
    """Return an earlier result whose file is still there, None without one."""
    try:
        stored = json.loads((output / CACHE / f'{key}.json').read_text(encoding='utf-8'))
        if _digest(output, stored['entry']) == stored['digest']:
            return dict(stored)
    except (OSError, ValueError, KeyError, TypeError):
        pass  # no result, or a damaged one
    return None


def _save(output: Path, key: str, robot: Robot, result: RobotResult) -> None:
    if result.model is not None:
        save_model(output / f'{robot.name}.json', result.model)
    else:
        text = json.dumps(result.diagnosis, indent=2) + '\n'
        write_atomically(output / f'{robot.name}.diagnosis.json', text.encode(), BagError)
    stored = {'entry': result.entry, 'failed_bags': result.failed_bags,
              'digest': _digest(output, result.entry)}
    write_atomically(output / CACHE / f'{key}.json', json.dumps(stored).encode(), BagError)


def _digest(output: Path, entry: Mapping[str, Any]) -> str:
    """Return the digest of the file of a robot."""
    name = entry['model'] if 'model' in entry else entry['diagnosis']
    return hashlib.sha256((output / name).read_bytes()).hexdigest()
