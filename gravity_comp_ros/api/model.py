"""`Model`, the public result of a fit: prediction, report, model file, undo."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gravity_comp_ros.api.provenance import now
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.display import Displayable, shortened, TextTable
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.models.gravity_model import ADDED, GravityModel, UPDATED
from gravity_comp_ros.models.history import undone
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.printable import counted
import numpy as np
from numpy.typing import ArrayLike

_MAX_TERMS = 6


@dataclass(frozen=True)
class JointFit:
    """
    Fit of one joint.

    `terms`: number of terms of the gravity equation. `q_min`, `q_max`: trained range, rad.
    `rmse`: root mean square of the training residual, N·m. `equation`: largest terms, in N·m.
    """

    terms: int
    q_min: float
    q_max: float
    rmse: float
    equation: str


@dataclass(frozen=True, repr=False)
class FitReport(Displayable):
    """
    Summary of a fit and of the last step.

        print(model.report)
        model.report.joints['elbow'].rmse       # N·m

    - `formulation`: `chain`, `potential` or `per_joint`.
    - `n_samples`, `n_runs`: size of the training data.
    - `joints`: the fit of each joint, by name.
    - `effects`: the effects of the model, as `NAME:JOINT`.
    - `last_step`: the effects of the last step, or `payload`; '' after a fit.
    - `held_out`: RMSE in N·m, by joint, on samples that were not fitted, before and after the
      last step; empty after a fit.
    - `payload`: `mass` (kg) and centre of mass (m, by axis) of the last update with known axes.
    - `warnings`: one line each.
    """

    formulation: str
    n_samples: int
    n_runs: int
    joints: Mapping[str, JointFit]
    effects: tuple[str, ...]
    last_step: str
    held_out: Mapping[str, tuple[float, float]]
    payload: Mapping[str, float]
    warnings: tuple[str, ...]

    def summary(self) -> str:
        """Return one line: formulation, samples, effects."""
        effects = f', with {", ".join(self.effects)}' if self.effects else ''
        return (f'gravity model, {self.formulation}: {counted(self.n_samples, "sample")} of '
                f'{counted(self.n_runs, "run")}{effects}')

    def details(self) -> Iterable[str | TextTable]:
        """Return a table of the joints, the payload and the warnings."""
        columns = ['joint', 'terms', 'from rad', 'to rad', 'RMSE N·m']
        rows = []
        for name, joint in self.joints.items():
            row = [name, str(joint.terms), f'{joint.q_min:.2f}', f'{joint.q_max:.2f}',
                   f'{joint.rmse:.4f}']
            rows.append((*row, *(f'{x:.4f}' for x in self.held_out.get(name, ()))))
        if self.held_out:
            columns += [f'before {self.last_step}', 'after']
        yield TextTable(tuple(columns), tuple(rows))
        if 'mass' in self.payload:
            yield 'payload: ' + ', '.join(f'{name} {value:+.3f} {"kg" if name == "mass" else "m"}'
                                          for name, value in self.payload.items())
        yield from (f'warning: {warning}' for warning in self.warnings)


@dataclass(frozen=True, eq=False, repr=False)
class Model(Displayable):
    """
    Gravity model of an arm, with its effects.

        model = gc.load('arm.json')
        tau = model.predict(q)                  # gravity torque, N·m, same shape as q in rad

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

    @cached_property
    def report(self) -> FitReport:
        """Return the summary of the fit and of the last step, from provenance and history."""
        model = self.gravity
        joints = {name: JointFit(int(model.n_features()[n]), float(model.coverage.q_min[n]),
                                 float(model.coverage.q_max[n]), float(model.noise[n]),
                                 shortened(model.equation(name), _MAX_TERMS))
                  for n, name in enumerate(model.joints)}
        step = model.history[-1] if model.history else None
        record = {'warnings': (model.provenance.get('report') or {}).get('warnings', ())}
        if step is not None and step.action == UPDATED:
            record = model.provenance['updates'][-1]
        return FitReport(
            model.formulation, model.coverage.n_samples, model.coverage.n_runs, joints,
            tuple(effect.target for effect in model.applied.effects),
            '' if step is None else ', '.join(step.effects),
            {} if step is None or step.action not in (ADDED, UPDATED) else
            {name: (step.before[name], step.after[name]) for name in step.before},
            _payload(record), tuple(record['warnings']))

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
        return self.report.summary()

    def details(self) -> Iterable[str | TextTable]:
        """Return the report and the equations."""
        yield from self.report.details()
        yield 'torque in N·m (s2, c2: sine and cosine of the angle of the second joint)'
        for name, joint in self.report.joints.items():
            yield f'{name} = {joint.equation}'


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


def _payload(record: Mapping[str, object]) -> dict[str, float]:
    payload = record.get('payload')
    if not isinstance(payload, dict):
        return {}
    centre = payload['centre'] or {}
    return {'mass': payload['mass']['value'], **{axis: x['value'] for axis, x in centre.items()}}
