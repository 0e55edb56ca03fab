"""Fit or diagnose every robot of a fleet; what was done already is not done again."""

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

What = TypeVar('What')
KEPT = '.fleet'  # the folder in the output folder that holds what a later run can use


@dataclass(frozen=True)
class FleetRun:
    """A fleet, where its results go, and where the work is done."""

    robots: Sequence[Robot]
    output: Path
    engine: Engine
    reading: ReadOptions = ReadOptions()
    gate: GateOptions = GateOptions()
    progress: Progress = lambda word, share: None

    def fit(self, options: LearnOptions = LearnOptions()) -> Outcome:
        """
        Fit each robot to all its bags that can be read; OUTPUT/ROBOT.json has the model.

        :raises BagError: if nothing can be written.
        """
        outcome, store = Outcome(), Store(self.output / KEPT)
        recordings = self._read(outcome, store)
        waiting = []
        for robot in self.robots:
            found = [recordings[bag] for bag in robot.bags if bag in recordings]
            key = _key('fit', robot.name, [r.report.sha256 for r in found], options,
                       self.reading, self.gate)
            done = store.note(key)
            if done is not None and _holds_model(self._model_file(robot)):
                outcome.robots[robot.name] = FittedRobot.from_json(done)
                outcome.resumed += 1
            else:
                waiting.append(((robot, key, found), found))
        task = partial(fit_robot, gate=self.gate, options=options)
        for (robot, key, found), result in self._work('fit', task, waiting):
            if isinstance(result, Failure):
                outcome.failed_robots[robot.name] = result.reason
                continue
            fitted = outcome.robots[robot.name] = self._save(robot, found, result)
            store.keep_note(key, fitted.to_json())
        return outcome

    def diagnose(self, models: Path | None = None,
                 effects: tuple[str, ...] | None = None) -> Outcome:
        """
        Diagnose each robot on all its bags; OUTPUT/ROBOT.diagnosis.json has the findings.

        :param models: folder with ROBOT.json for each robot; None fits one on the spot.
        :raises BagError: if nothing can be written.
        """
        outcome, store = Outcome(), Store(self.output / KEPT)
        waiting = []
        for robot in self.robots:
            try:
                model = load_model(models / f'{robot.name}.json') if models else None
            except GravityCompError as error:
                outcome.failed_robots[robot.name] = str(error)
                continue
            key = _key('diagnose', robot.name, [fingerprint_of(bag) for bag in robot.bags],
                       self.reading, effects, _told(model))
            done = store.note(key)
            if done is None:
                waiting.append(((robot, key), (robot.bags, model)))
                continue
            outcome.resumed += 1
            self._tell(outcome, robot, done)
        task = partial(diagnose_robot, options=self.reading, effects=effects)
        for (robot, key), result in self._work('diagnose', task, waiting):
            if isinstance(result, Failure):
                outcome.failed_robots[robot.name] = result.reason
                continue
            found, failed = result
            done = {'diagnosis': found.to_json(), 'failed': failed}
            store.keep_note(key, done)
            self._tell(outcome, robot, done)
        return outcome

    def _read(self, outcome: Outcome, store: Store) -> dict[Path, GatedRecording]:
        """Return what was read of every bag, kept from earlier or read now."""
        found, waiting = {}, []
        for bag in (bag for robot in self.robots for bag in robot.bags):
            key = fingerprint_of(bag, self.reading, self.gate)
            before = store.recording(key)
            if before is None:
                waiting.append(((bag, key), bag))
            else:
                found[bag] = before
                outcome.resumed += 1
        task = partial(read, options=self.reading, gate=self.gate)
        for (bag, key), result in self._work('read', task, waiting):
            if isinstance(result, Failure):
                outcome.failed_bags[str(bag)] = result.reason
            else:
                store.keep(key, result)
                found[bag] = result
        return found

    def _work(self, word: str, task: Task[Item, Result], waiting: Sequence[tuple[What, Item]]
              ) -> Iterator[tuple[What, Result | Failure]]:
        """Yield what each task was for, and its result, as they come."""
        running = self.engine.run(task, [item for _, item in waiting])
        for count, (number, result) in enumerate(running, start=1):
            self.progress(word, count / len(waiting))
            yield waiting[number][0], result

    def _model_file(self, robot: Robot) -> Path:
        return self.output / f'{robot.name}.json'

    def _save(self, robot: Robot, found: list[GatedRecording],
              result: FitResult) -> FittedRobot:
        model = result.model
        save_model(self._model_file(robot), model)
        return FittedRobot(self._model_file(robot).name, len(found), model.coverage.n_samples,
                           result.converged, result.report.rmse, result.report.warnings)

    def _tell(self, outcome: Outcome, robot: Robot, done: dict[str, Any]) -> None:
        outcome.failed_bags.update(done['failed'])
        file = self.output / f'{robot.name}.diagnosis.json'
        write_atomically(file, (json.dumps(done['diagnosis'], indent=2) + '\n').encode(),
                         BagError)
        outcome.robots[robot.name] = DiagnosedRobot.from_json(file.name, done['diagnosis'])


def _holds_model(path: Path) -> bool:
    try:
        load_model(path)
    except GravityCompError:
        return False
    return True


def _told(model: GravityModel | None) -> object:
    if model is None:
        return None
    return [(t.indices.tolist(), t.weights.tolist()) for t in model.torques], repr(model.applied)


def _key(*parts: object) -> str:
    plain = [asdict(part) if is_dataclass(part) and not isinstance(part, type) else part
             for part in parts]
    return hashlib.sha256(repr(plain).encode()).hexdigest()[:32]
