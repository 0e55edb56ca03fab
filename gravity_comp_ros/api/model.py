"""`Model`: what a fit yields, for people: it predicts, prints, saves, and goes back a step."""

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

_TERMS = 6


@dataclass(frozen=True)
class JointFit:
    """
    How one joint was fitted.

    `terms` of the equation; the trained range `q_min` to `q_max` in rad; `rmse`, the residual's
    root mean square in training, in N·m; the `equation` with its largest terms, in N·m.
    """

    terms: int
    q_min: float
    q_max: float
    rmse: float
    equation: str


@dataclass(frozen=True, repr=False)
class FitReport(Displayable):
    """
    How a model came about.

    `held_out` is the RMSE by joint in N·m on samples that were not fitted, before and after
    the last step; empty of a model without such a step. `payload` are mass (kg) and centre of
    mass (m, by axis) of the last update, where the axes of the arm were known.
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

    def parts(self) -> Iterable[str | TextTable]:
        """Return the joints, what the last step changed, and warnings."""
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
    The gravity torque of an arm, and the effects that it was given.

    `gravity` is the model as the node and the model file hold it. A model never changes: the
    steps of the loop return new ones, and each knows the one before it (`undo`).
    """

    gravity: GravityModel

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the joints, in the order of every array."""
        return self.gravity.joints

    @property
    def effects(self) -> tuple[str, ...]:
        """Return the effects of the model as `NAME:JOINT`."""
        return tuple(effect.target for effect in self.gravity.applied.effects)

    @cached_property
    def report(self) -> FitReport:
        """Return how the model came about."""
        return report_of(self.gravity)

    def predict(self, q: ArrayLike) -> FloatArray:
        """
        Return the gravity torque in N·m, (M, N) or (N,), of poses `q` in rad of that shape.

        :raises DataError: if q has another number of joints.
        """
        return _shaped(self.gravity.predict, q)

    def predict_std(self, q: ArrayLike) -> FloatArray:
        """
        Return the standard deviation in N·m of `predict`, of the same shape.

        :raises DataError: if the formulation has no uncertainty.
        """
        return _shaped(self.gravity.predict_std, q)

    def torque(self, recording: Recording) -> FloatArray:
        """
        Return gravity and effects, (M, N) in N·m, for every sample of a recording.

        :raises ModelMismatchError: if it lacks a joint of the model.
        """
        return predict_torque(self.gravity, recording.samples)

    def equation(self, joint: str, digits: int = 2) -> str:
        """
        Return a joint's torque in N·m as an equation, e.g. `-20.81 s1 c2 + 3.10 s2`.

        :raises DataError: if there is no such joint.
        """
        return self.gravity.equation(joint, digits)

    def undo(self) -> Model:
        """
        Return the model before the last effects or payload.

        :raises DataError: if there is nothing to undo.
        """
        return Model(undone(self.gravity, now()))

    def save(self, path: str | Path) -> None:
        """
        Write the model file that the node and the commands read.

        :raises ModelFileError: if it cannot be written.
        """
        save_model(path, self.gravity)

    def summary(self) -> str:
        """Return one line: formulation, samples, effects."""
        return self.report.summary()

    def parts(self) -> Iterable[str | TextTable]:
        """Return the report and the equations."""
        yield from self.report.parts()
        yield 'torque in N·m (s2, c2: sine and cosine of the angle of the second joint)'
        for name, joint in self.report.joints.items():
            yield f'{name} = {joint.equation}'


def _shaped(predict: Callable[[FloatArray], FloatArray], q: ArrayLike) -> FloatArray:
    poses = np.asarray(q, dtype=np.float64)
    found = predict(poses)
    return found[0] if poses.ndim == 1 else found


def load(path: str | Path) -> Model:
    """
    Read a model file.

    :raises ModelFileError: if there is none, or it is damaged or of another version.
    """
    return Model(load_model(Path(path)))


def save(model: Model, path: str | Path) -> None:
    """
    Write a model file; an existing one is replaced as a whole or not at all.

    :raises ModelFileError: if it cannot be written.
    """
    model.save(path)


def report_of(model: GravityModel) -> FitReport:
    """Return how a model came about, as far as the model itself holds it."""
    joints = {name: JointFit(int(model.n_features()[n]), float(model.coverage.q_min[n]),
                             float(model.coverage.q_max[n]), float(model.noise[n]),
                             shortened(model.equation(name), _TERMS))
              for n, name in enumerate(model.joints)}
    step = model.history[-1] if model.history else None
    told = {'warnings': (model.provenance.get('report') or {}).get('warnings', ())}
    if step is not None and step.action == UPDATED:
        told = model.provenance['updates'][-1]
    return FitReport(
        model.formulation, model.coverage.n_samples, model.coverage.n_runs, joints,
        tuple(effect.target for effect in model.applied.effects),
        '' if step is None else ', '.join(step.effects),
        {} if step is None or step.action not in (ADDED, UPDATED) else
        {name: (step.before[name], step.after[name]) for name in step.before},
        _payload(told), tuple(told['warnings']))


def _payload(told: Mapping[str, object]) -> dict[str, float]:
    payload = told.get('payload')
    if not isinstance(payload, dict):
        return {}
    centre = payload['centre'] or {}
    return {'mass': payload['mass']['value'], **{axis: x['value'] for axis, x in centre.items()}}
