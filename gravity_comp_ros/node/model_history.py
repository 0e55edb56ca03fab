"""Model in use, models of earlier payloads, and the model file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from os.path import expanduser
from threading import Thread

from gravity_comp_ros.errors import ModelFileError
from gravity_comp_ros.evaluation.expected_residual import expected_residual
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.node.options import NODE

Reply = Callable[[bool, str], None]


@dataclass(frozen=True)
class Entry:
    """A model, its origin, time of its first use in s, and epoch."""

    model: GravityModel
    origin: str
    since: float
    epoch: int

    def describe(self) -> str:
        """Return a one-line description of the model."""
        coverage = self.model.coverage
        return (f'{self.model.formulation} model of {self.model.n_joints} joints, '
                f'{int(self.model.n_features().sum())} features, {coverage.n_samples} samples, '
                f'{self.origin}')


class ModelHistory:
    """
    The model in use, and the last model of each of up to `NODE.depth` earlier payloads.

    Threads write the file one after the other: a slow disk delays nothing else, and the file
    always has the model of the last save.

    :param path: the model file; empty if there is none.
    """

    def __init__(self, path: str) -> None:
        # Unlike that of Path, this function has no error where a user does not exist.
        self.path = expanduser(path)
        self.entry: Entry | None = None
        # The last model of each earlier payload.
        self.past: list[Entry] = []
        # Error of the last save, and of loading the file, which is then written on request only.
        self.problem = self.load_problem = ''
        # The thread of the last save.
        self._writer: Thread | None = None

    @property
    def model(self) -> GravityModel | None:
        """The model in use."""
        return self.entry.model if self.entry else None

    def use(self, model: GravityModel, origin: str, now: float, epoch: int) -> None:
        """
        Take a model into use.

        It replaces the model of the same epoch, so `roll_back` returns to the previous payload
        regardless of the number of fits.
        """
        if self.entry is not None and self.entry.epoch != epoch:
            self.past.append(self.entry)
            del self.past[:-NODE.depth]
        self.entry = Entry(model, origin, now, epoch)

    def roll_back(self, now: float) -> Entry | None:
        """Bring back the last model of the previous payload; return None if there is none."""
        if not self.past:
            return None
        self.entry = replace(self.past.pop(), since=now)
        return self.entry

    def load(self, joints: tuple[str, ...], now: float) -> None:
        """
        Take the model of the file into use, if the file exists; errors go to `load_problem`.

        :param joints: the joints that the model must have, in this order; empty for any.
        """
        if not self.path:
            return
        try:
            model = load_model(self.path)
            # An error of an effect that another version fitted occurs before the loop.
            expected_residual(model)
        except Exception as problem:
            if not isinstance(problem.__cause__, FileNotFoundError):
                self.load_problem = str(problem) if isinstance(problem, ModelFileError) else (
                    f'{self.path} is not used: {type(problem).__name__}: {problem}')
            return
        if joints and model.joints != joints:
            self.load_problem = (
                f'{self.path} is a model of {", ".join(model.joints)}; the parameter joints '
                f'is {", ".join(joints)}')
            return
        # Of an earlier epoch than any model that is learned, so that a rollback returns to it.
        self.use(model, f'loaded from {self.path}', now, -1)

    def save(self, reply: Reply) -> None:
        """Write the present model after all earlier saves; reply now, or from another thread."""
        if self.entry is None:
            reply(False, 'there is no model to save yet')
        elif not self.path:
            reply(False, 'no file to save to: set the parameter model_file')
        else:
            self._writer = Thread(target=self._write, daemon=True,
                                  args=(self.entry, reply, self._writer))
            self._writer.start()

    def close(self) -> None:
        """Finish pending saves, for a second at most."""
        if self._writer is not None:
            self._writer.join(NODE.last_save)

    def _write(self, entry: Entry, reply: Reply, earlier: Thread | None) -> None:
        if earlier is not None:
            earlier.join()
        try:
            save_model(self.path, entry.model)
        except Exception as problem:
            # Each call must end.
            self.problem = str(problem) if isinstance(problem, ModelFileError) else (
                f'cannot save the model: {type(problem).__name__}: {problem}')
            reply(False, self.problem)
        else:
            self.problem = self.load_problem = ''
            reply(True, f'saved the {entry.describe()} to {self.path}')
