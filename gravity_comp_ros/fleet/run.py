"""
Fit or diagnosis of every robot of a folder on a Dask cluster; an interrupted run is resumed.

Dask sends pickled functions and data, so a program that reaches a scheduler or a worker can run
code there. The connections of this machine stay on the loopback interface, encrypted where the
package `cryptography` is installed; those of a scheduler with an address tls://HOST:PORT.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
import hashlib
import importlib.util
from itertools import islice
import json
import logging
from pathlib import Path
from queue import SimpleQueue
import signal
import threading
from typing import Any

from distributed import as_completed, Client, Future, KilledWorker, LocalCluster, Security
from gravity_comp_ros import __version__
from gravity_comp_ros.api.axes import ArmOptions
from gravity_comp_ros.api.read import bounded, joined
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.api.steps import diagnose_recording, learn
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import BagError, DataError, FitError, GravityCompError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.storage import data_files
from tornado.ioloop import IOLoop

_SUFFIXES = ('.mcap', '.db3', '.mcap.zstd', '.db3.zstd')
# Timeout of the connection to a scheduler, s.
_CONNECT = 30.0


@dataclass(frozen=True)
class ClusterOptions:
    """
    Place of the tasks: `workers` processes of this machine, or the cluster of a scheduler.

    A single worker is a thread of this process. `scheduler` is an address; certificates for
    tls://HOST:PORT are in the configuration of Dask (`distributed.comm.tls`).
    """

    workers: int = 1
    scheduler: str | None = None

    @property
    def warning(self) -> str:
        """Return a warning if other hosts or users can reach the workers, else ''."""
        if self.scheduler is not None:
            return '' if self.scheduler.startswith('tls://') else (
                f'{self.scheduler} is not encrypted: a program that reaches it can run code on '
                'its workers and here; docs/fleet.md describes TLS')
        if self.workers > 1 and not _can_encrypt():
            return ('the workers are not encrypted: other users of this machine could run code in '
                    'them (pip install cryptography)')
        return ''


def run_tasks(options: ClusterOptions, task: Callable[[Any], Any],
              items: Sequence[Any]) -> Iterator[tuple[int, Any, str]]:
    """
    Yield index, result, and reason of a failure in one line ('' for none) in order of completion.

    Dask repeats the task of a worker that died.

    :param task: function of a module, of one argument.
    :raises DataError: if the scheduler cannot be reached.
    """
    with _client(options) as client, client.as_current():
        completed, numbers = as_completed(), dict[Future, int]()
        waiting = iter(enumerate(items))

        def submit() -> None:
            # One task a thread at most: a task that kills its worker takes no other with it.
            free = max(sum(client.nthreads().values()), 1) - len(numbers)
            for number, item in islice(waiting, max(free, 0)):
                future = client.submit(task, item, pure=False)
                numbers[future] = number
                completed.add(future)

        submit()
        for future in completed:
            number, error = numbers.pop(future), future.exception()
            if error is None:
                yield number, future.result(), ''
            else:
                yield number, None, _reason(error)
            future.release()
            submit()


def _reason(error: BaseException) -> str:
    if isinstance(error, GravityCompError):
        return str(error)
    if isinstance(error, KilledWorker):
        return 'its workers died, possibly out of memory'
    return f'internal error: {type(error).__name__}: ' + ' '.join(str(error).split())


@contextmanager
def _client(options: ClusterOptions) -> Iterator[Client]:
    if options.scheduler is None:
        with _local_cluster(options) as cluster, \
                Client(cluster, set_as_default=False) as client:
            yield client
        return
    try:
        client = Client(options.scheduler, timeout=_CONNECT, set_as_default=False,
                        loop=_event_loop())
    except (OSError, ValueError, TypeError) as error:
        raise DataError(f'no Dask scheduler answers at {options.scheduler}: '
                        f'{" ".join(str(error).split())}') from None
    with client:
        yield client


@cache
def _event_loop() -> IOLoop:
    """Return the event loop of this process, in a thread; the start of Dask's own may time out."""
    started = SimpleQueue[IOLoop]()

    async def run() -> None:
        started.put(IOLoop.current())
        await asyncio.Event().wait()

    threading.Thread(target=asyncio.run, args=(run(),), daemon=True).start()
    return started.get()


def _local_cluster(options: ClusterOptions) -> LocalCluster:
    """Return a started cluster; an interrupt ends this process alone, which ends the others."""
    in_main = threading.current_thread() is threading.main_thread()
    # Processes inherit an ignored signal.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if in_main else None
    try:
        # No limit of memory: a worker could not go on with less than its recordings need.
        return LocalCluster(
            n_workers=options.workers, threads_per_worker=1, processes=options.workers > 1,
            memory_limit=0, dashboard_address=None, silence_logs=logging.CRITICAL,
            loop=_event_loop(),
            security=Security.temporary() if _can_encrypt() else None)
    finally:
        if in_main:
            signal.signal(signal.SIGINT, before)


def _can_encrypt() -> bool:
    return importlib.util.find_spec('cryptography') is not None


def find_robots(folder: Path) -> dict[str, tuple[Path, ...]]:
    """
    Return the bags of each robot of a fleet, by its name, both sorted by name.

    Each subfolder is a robot, unless it is a rosbag2 folder. Bags directly in `folder` belong to
    one robot with the name of the folder.

    :raises BagError: if the folder does not exist or contains no bag.
    """
    try:
        entries = sorted(path for path in folder.iterdir() if not path.name.startswith('.'))
    except OSError as error:
        raise BagError(f'cannot read the fleet {folder}: {error.strerror}') from None
    robots: dict[str, tuple[Path, ...]] = {}
    for robot in (folder, *(path for path in entries if path.is_dir() and not _is_bag(path))):
        name, bags = (robot.resolve() if robot is folder else robot).name, _bags(robot)
        if bags and name in robots:
            raise BagError(f'two robots are named {name}: {folder} has bags of its own and a '
                           f'subfolder of the same name')
        robots |= {name: bags} if bags else {}
    for name in robots:
        if f'{name}.diagnosis' in robots:
            raise BagError(f'the model of robot {name}.diagnosis would have the name of the '
                           f'diagnosis of {name}: rename its folder')
    if not robots:
        raise BagError(f'{folder} contains no recording: put the bags of each robot into a '
                       f'subfolder with its name')
    return dict(sorted(robots.items()))


def _bags(folder: Path) -> tuple[Path, ...]:
    try:
        return tuple(sorted(path for path in folder.iterdir() if _is_bag(path)))
    except OSError:
        return ()


def state_of(path: Path) -> list[tuple[str, int, int]]:
    """Return name, size and time of change in ns of the files of a bag, or of a file."""
    try:
        return [(str(file), file.stat().st_size, file.stat().st_mtime_ns)
                for file in data_files(path)]
    except (BagError, OSError) as error:
        return [(f'{path}: {error}', 0, 0)]


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
    learning: ArmOptions = ArmOptions()
    models: Path | None = None
    effects: tuple[str, ...] | None = None


# Result of one robot as it is stored: `entry` of `fleet --json`, and reasons of `failed_bags`.
Stored = dict[str, Any]
# Content of its file: the fitted model, or a diagnosis in the form of `diagnose --json`.
Content = GravityModel | dict[str, Any]


@dataclass
class Outcome:
    """Entries of a fleet run by robot, reasons of failures, number of robots of earlier runs."""

    robots: dict[str, dict[str, Any]] = field(default_factory=dict)
    failed_bags: dict[str, str] = field(default_factory=dict)
    failed_robots: dict[str, str] = field(default_factory=dict)
    resumed: int = 0

    def add(self, name: str, stored: Stored) -> None:
        """Add the result of a robot."""
        self.robots[name] = stored['entry']
        self.failed_bags |= stored['failed_bags']


def run_fleet(robots: Mapping[str, tuple[Path, ...]], output: Path, options: FleetOptions,
              cluster: ClusterOptions = ClusterOptions(),
              progress: Progress = lambda step, fraction: None) -> Outcome:
    """
    Fit or diagnose every robot, each with all its readable bags.

    A result is stored in OUTPUT/.fleet under the version of this package, the files and the
    options. The same call goes on where an earlier one ended.

    :param robots: as of `find_robots`.
    :raises BagError: if a result cannot be written.
    :raises DataError: if the cluster cannot be reached.
    """
    try:
        (output / CACHE).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BagError(f'cannot create the folder {output}: {error.strerror}') from None
    outcome, pending = Outcome(), []
    keys = {name: _key(name, bags, options) for name, bags in robots.items()}
    for name, bags in robots.items():
        stored = _stored(output, keys[name])
        if stored is None:
            pending.append((name, bags))
        else:
            outcome.resumed += 1
            outcome.add(name, stored)
    tasks = run_tasks(cluster, partial(_result, options=options), pending) if pending else ()
    for count, (number, result, reason) in enumerate(tasks, start=1):
        name = pending[number][0]
        progress(f'{options.step} {name}', count / len(pending))
        if reason:
            outcome.failed_robots[name] = reason
            continue
        _save(output, keys[name], *result)
        outcome.add(name, result[0])
    return outcome


def _result(robot: tuple[str, tuple[Path, ...]], options: FleetOptions) -> tuple[Stored, Content]:
    """
    Return the result of one robot, of its name and bags; runs on a worker and writes no file.

    :raises FitError: if none of its bags can be read, or the fit fails.
    """
    name, bags = robot
    if options.step == 'fit':
        recording, failed = _read(bags, options.reading, options.gate)
        learned = learn(recording, options.learning)
        result, facts = learned.result, [fact.sentence for fact in learned.facts]
        return {'failed_bags': failed, 'entry': {
            'model': f'{name}.json', 'bags': recording.n_runs,
            'samples': result.model.coverage.n_samples, 'converged': result.converged,
            'rmse': result.report.rmse, 'warnings': [*result.report.warnings, *facts]}
        }, result.model
    model = load_model(options.models / f'{name}.json') if options.models else None
    reading = options.reading
    if model is not None and reading.joints is None:
        reading = replace(reading, joints=model.joints)
    recording, failed = _read(bags, reading, options.gate)
    document = diagnose_recording(recording, model, options.effects,
                                  options.learning).diagnosis.to_json()
    return {'failed_bags': failed, 'entry': {
        'diagnosis': f'{name}.diagnosis.json', 'findings': document['findings']}}, document


def _read(bags: Sequence[Path], options: ReadOptions,
          gate: GateOptions | None) -> tuple[Recording, dict[str, str]]:
    """Return the readable bags of a robot as one recording, and the reasons of the others."""
    runs, failed, options = [], {}, bounded(options, len(bags))
    for bag in bags:
        try:
            runs.append(read_bag(bag, options))
            options = runs[-1].report.options
        except GravityCompError as error:
            failed[str(bag)] = str(error)
    if not runs:
        raise FitError(f'none of its bags could be read: {"; ".join(failed.values())}')
    return joined(runs, gate), failed


def _key(name: str, bags: Sequence[Path], options: FleetOptions) -> str:
    """Return the name of a result in the cache."""
    models = [options.models / f'{name}.json'] if options.models else []
    parts = (__version__, asdict(options), name, [state_of(file) for file in (*bags, *models)])
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def _stored(output: Path, key: str) -> Stored | None:
    """Return an earlier result whose file is unchanged, None without one."""
    try:
        stored = json.loads((output / CACHE / f'{key}.json').read_text(encoding='utf-8'))
        if _digest(_file(output, stored['entry'])) == stored['digest']:
            return dict(stored)
    except (OSError, ValueError, KeyError, TypeError):
        pass  # no result, or a damaged one
    return None


def _save(output: Path, key: str, stored: Stored, content: Content) -> None:
    file = _file(output, stored['entry'])
    if isinstance(content, GravityModel):
        save_model(file, content)
    else:
        write_atomically(file, (json.dumps(content, indent=2) + '\n').encode(), BagError)
    text = json.dumps({**stored, 'digest': _digest(file)})
    write_atomically(output / CACHE / f'{key}.json', text.encode(), BagError)


def _file(output: Path, entry: Mapping[str, Any]) -> Path:
    return output / str(entry.get('model') or entry['diagnosis'])


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
