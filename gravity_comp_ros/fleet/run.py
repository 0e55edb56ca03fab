"""Fit or diagnosis of every robot of a fleet; completed work is resumed from a cache."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from functools import partial
import hashlib
import json
from pathlib import Path
from typing import Any, TypeVar

from gravity_comp_ros.api.learn import LearnOptions
from gravity_comp_ros.api.recording import Progress
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import BagError, GravityCompError
from gravity_comp_ros.estimation.fit import FitResult
from gravity_comp_ros.fleet.engine import Engine, Failure, Item, Result, Task
from gravity_comp_ros.fleet.folder import fingerprint_of, Robot
from gravity_comp_ros.fleet.outcome import DiagnosedRobot, FittedRobot, Outcome
from gravity_comp_ros.fleet.store import Store
from gravity_comp_ros.fleet.tasks import diagnose_robot, fit_robot, read
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.recordings.gated_bag import GatedRecording

Label = TypeVar('Label')
CACHE = '.fleet'  # subfolder of the output folder


@dataclass(frozen=True)
class FleetRun:
    """A fleet, its output folder, and the engine that runs its tasks."""

    robots: Sequence[Robot]
    output: Path
    engine: Engine
    reading: ReadOptions = ReadOptions()
    gate: GateOptions = GateOptions()
    progress: Progress = lambda step, fraction: None

    def fit(self, options: LearnOptions = LearnOptions()) -> Outcome:
        """
        Fit each robot to all its readable bags; write the model to OUTPUT/ROBOT.json.

        :raises BagError: if a result cannot be written.
        """
        outcome, store = Outcome(), Store(self.output / CACHE)
        recordings = self._read(outcome, store)
        pending = []
        for robot in self.robots:
            runs = [recordings[bag] for bag in robot.bags if bag in recordings]
            key = _key('fit', robot.name, [run.report.sha256 for run in runs], options,
                       self.reading, self.gate)
            stored = store.load_result(key)
            if stored is not None and _is_model_file(self._model_file(robot)):
                outcome.robots[robot.name] = FittedRobot.from_json(stored)
                outcome.resumed += 1
            else:
                pending.append(((robot, key, runs), runs))
        task = partial(fit_robot, gate=self.gate, options=options)
        for (robot, key, runs), result in self._work('fit', task, pending):
            if isinstance(result, Failure):
                outcome.failed_robots[robot.name] = result.reason
                continue
            fitted = outcome.robots[robot.name] = self._save_model(robot, len(runs), result)
            store.save_result(key, fitted.to_json())
        return outcome

    def diagnose(self, models: Path | None = None,
                 effects: tuple[str, ...] | None = None) -> Outcome:
        """
        Diagnose each robot on all its bags; write the result to OUTPUT/ROBOT.diagnosis.json.

        :param models: folder with ROBOT.json for each robot; None fits a model first.
        :raises BagError: if a result cannot be written.
        """
        outcome, store = Outcome(), Store(self.output / CACHE)
        pending = []
        for robot in self.robots:
            try:
                model = load_model(models / f'{robot.name}.json') if models else None
            except GravityCompError as error:
                outcome.failed_robots[robot.name] = str(error)
                continue
            key = _key('diagnose', robot.name, [fingerprint_of(bag) for bag in robot.bags],
                       self.reading, effects, _model_key(model))
            stored = store.load_result(key)
            if stored is None:
                pending.append(((robot, key), (robot.bags, model)))
                continue
            outcome.resumed += 1
            self._save_diagnosis(outcome, robot, stored)
        task = partial(diagnose_robot, options=self.reading, effects=effects)
        for (robot, key), result in self._work('diagnose', task, pending):
            if isinstance(result, Failure):
                outcome.failed_robots[robot.name] = result.reason
                continue
            diagnosis, failed = result
            record = {'diagnosis': diagnosis.to_json(), 'failed': failed}
            store.save_result(key, record)
            self._save_diagnosis(outcome, robot, record)
        return outcome

    def _read(self, outcome: Outcome, store: Store) -> dict[Path, GatedRecording]:
        """Return the slow samples of every readable bag, from the cache or the file."""
        recordings, pending = {}, []
        for bag in (bag for robot in self.robots for bag in robot.bags):
            key = fingerprint_of(bag, self.reading, self.gate)
            cached = store.load_recording(key)
            if cached is None:
                pending.append(((bag, key), bag))
            else:
                recordings[bag] = cached
                outcome.resumed += 1
        task = partial(read, options=self.reading, gate=self.gate)
        for (bag, key), result in self._work('read', task, pending):
            if isinstance(result, Failure):
                outcome.failed_bags[str(bag)] = result.reason
            else:
                store.save_recording(key, result)
                recordings[bag] = result
        return recordings

    def _work(self, step: str, task: Task[Item, Result], pending: Sequence[tuple[Label, Item]]
              ) -> Iterator[tuple[Label, Result | Failure]]:
        """Yield the label and the result of each task, in order of completion."""
        running = self.engine.run(task, [item for _, item in pending])
        for count, (number, result) in enumerate(running, start=1):
            self.progress(step, count / len(pending))
            yield pending[number][0], result

    def _model_file(self, robot: Robot) -> Path:
        return self.output / f'{robot.name}.json'

    def _save_model(self, robot: Robot, n_bags: int, result: FitResult) -> FittedRobot:
        model = result.model
        save_model(self._model_file(robot), model)
        return FittedRobot(self._model_file(robot).name, n_bags, model.coverage.n_samples,
                           result.converged, result.report.rmse, result.report.warnings)

    def _save_diagnosis(self, outcome: Outcome, robot: Robot, record: dict[str, Any]) -> None:
        outcome.failed_bags.update(record['failed'])
        file = self.output / f'{robot.name}.diagnosis.json'
        write_atomically(file, (json.dumps(record['diagnosis'], indent=2) + '\n').encode(),
                         BagError)
        outcome.robots[robot.name] = DiagnosedRobot.from_json(file.name, record['diagnosis'])


def _is_model_file(path: Path) -> bool:
    try:
        load_model(path)
    except GravityCompError:
        return False
    return True


def _model_key(model: GravityModel | None) -> object:
    if model is None:
        return None
    return [(t.indices.tolist(), t.weights.tolist()) for t in model.torques], repr(model.applied)


def _key(*parts: object) -> str:
    plain = [asdict(part) if is_dataclass(part) and not isinstance(part, type) else part
             for part in parts]
    return hashlib.sha256(repr(plain).encode()).hexdigest()[:32]
