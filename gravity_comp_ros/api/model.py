"""`Model`, the public result of a fit: prediction, errors, model file, undo."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.display import Displayable, shortened, TextTable
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.models.gravity_model import ADDED, GravityModel, Step, UPDATED
from gravity_comp_ros.models.history import now, undone
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.printable import counted
import numpy as np
from numpy.typing import ArrayLike

_MAX_TERMS = 6


@dataclass(frozen=True, eq=False, repr=False)
class Model(Displayable):
    """
    Gravity model of an arm, with its effects.

        model = gc.load('arm.json')
        tau = model.predict(q)                  # gravity torque, N·m, same shape as q in rad
        print(model)                            # range and error of each joint, equations

    A model is immutable. Each step of the loop returns a new model, whose history contains the
    previous one (`undo`). `gravity` is the model in the form used by the node and the model file.
    """

    gravity: GravityModel

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the N joints, in the order of the columns of all arrays."""
        return self.gravity.joints

    @property
    def effects(self) -> tuple[str, ...]:
        """Return the effects of the model as `NAME:JOINT`."""
        return tuple(effect.target for effect in self.gravity.applied.effects)

    @property
    def held_out(self) -> dict[str, tuple[float, float]]:
        """
        Return the RMSE in N·m by joint on samples that were not fitted, before and after a step.

        The step is the last addition or update; without one, the result is empty.
        """
        step = self._last_step
        return {} if step is None else {
            name: (step.before[name], step.after[name]) for name in step.before}

    @property
    def payload(self) -> dict[str, float]:
        """
        Return `mass` in kg and centre of mass (`x`, `y`, `z`, m), if the last step is an update.

        Without known axes it is empty; without a significant mass it has no centre.
        """
        payload = self._record.get('payload')
        if not isinstance(payload, dict):
            return {}
        centre = payload['centre'] or {}
        return {'mass': payload['mass']['value'],
                **{axis: x['value'] for axis, x in centre.items()}}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return the warnings about the fit, or the update if it is the last step."""
        return tuple(self._record.get('warnings', ()))

    @property
    def _last_step(self) -> Step | None:
        step = self.gravity.history[-1] if self.gravity.history else None
        return step if step is not None and step.action in (ADDED, UPDATED) else None

    @property
    def _record(self) -> Mapping[str, Any]:
        """Return the entry of the provenance about the last update, or about the fit."""
        step, provenance = self._last_step, self.gravity.provenance
        if step is not None and step.action == UPDATED:
            return provenance['updates'][-1]  # type: ignore[no-any-return]
        return provenance.get('report') or {}

    def predict(self, q: ArrayLike) -> FloatArray:
        """
        Return the gravity torque, (M, N) or (N,), in N·m, without effects.

        :param q: joint positions, (M, N) or (N,), in rad.
        :raises DataError: if q has another number of joints.
        """
        return _shaped(self.gravity.predict, q)

    def predict_std(self, q: ArrayLike) -> FloatArray:
        """
        Return the standard deviation of `predict`, (M, N) or (N,), in N·m.

        :param q: joint positions, (M, N) or (N,), in rad.
        :raises DataError: if q has another number of joints, or the model has no covariance.
        """
        return _shaped(self.gravity.predict_std, q)

    def torque(self, recording: Recording) -> FloatArray:
        """
        Return the torque of gravity and effects, (M, N) in N·m, for all samples.

        :raises ModelMismatchError: if a joint of the model is missing in the recording.
        """
        return predict_torque(self.gravity, recording.samples)

    def equation(self, joint: str, digits: int = 2) -> str:
        """
        Return the gravity torque of a joint in N·m as text, e.g. `-20.81 s1 c2 + 3.10 s2`.

        `s2` and `c2` are the sine and cosine of the position of the second joint.

        :param digits: decimals of the coefficients.
        :raises DataError: if there is no such joint.
        """
        return self.gravity.equation(joint, digits)

    def undo(self) -> Model:
        """
        Return the model before the last addition of effects or payload update.

        :raises DataError: if there is nothing to undo.
        """
        return Model(undone(self.gravity, now()))

    def save(self, path: str | Path) -> None:
        """
        Write the model file for the node and the commands; an existing file is replaced.

        :raises ModelFileError: if it cannot be written.
        """
        save_model(path, self.gravity)

    def summary(self) -> str:
        """Return one line: formulation, samples, effects."""
        model = self.gravity
        effects = f', with {", ".join(self.effects)}' if self.effects else ''
        return (f'gravity model, {model.formulation}: '
                f'{counted(model.coverage.n_samples, "sample")} of '
                f'{counted(model.coverage.n_runs, "run")}{effects}')

    def details(self) -> Iterable[str | TextTable]:
        """Return a table of the joints, the payload, the warnings and the equations."""
        model, step, held_out = self.gravity, self._last_step, self.held_out
        columns = ['joint', 'terms', 'from rad', 'to rad', 'RMSE N·m']
        if step is not None and held_out:
            columns += [f'before {", ".join(step.effects)}', 'after']
        yield TextTable(tuple(columns), tuple(
            (name, str(terms), f'{low:.2f}', f'{high:.2f}', f'{rmse:.4f}',
             *(f'{x:.4f}' for x in held_out.get(name, ())))
            for name, terms, low, high, rmse in zip(
                self.joints, model.n_features(), model.coverage.q_min, model.coverage.q_max,
                model.noise)))
        if self.payload:
            yield 'payload: ' + ', '.join(f'{name} {value:+.3f} {"kg" if name == "mass" else "m"}'
                                          for name, value in self.payload.items())
        yield from (f'warning: {warning}' for warning in self.warnings)
        yield 'torque in N·m (s2, c2: sine and cosine of the angle of the second joint)'
        yield from (f'{name} = {shortened(model.equation(name), _MAX_TERMS)}'
                    for name in self.joints)


def _shaped(predict: Callable[[FloatArray], FloatArray], q: ArrayLike) -> FloatArray:
    positions = np.asarray(q, dtype=np.float64)
    torque = predict(positions)
    return torque[0] if positions.ndim == 1 else torque


def load(path: str | Path) -> Model:
    """
    Read a model file.

        model = gc.load('arm.json')

    :raises ModelFileError: if it is missing, damaged or of another version.
    """
    return Model(load_model(Path(path)))
