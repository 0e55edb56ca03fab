"""
The gravity model: the result of a fit, the content of a model file, the input of a controller.

In every formulation the torque of a joint is a sparse sum over the dictionary,
tau_n(q) = sum_k w_nk phi_k(q) (Yu 2022, Eqs. 5-7), so one class prints, predicts and stores all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
import math
from typing import Any

from gravity_comp_ros.data.poses import batches
from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect
from gravity_comp_ros.models.kinematic.chain import Chain, expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.least_squares import lstsq, square_root
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

# Number of features above which the chain itself is evaluated faster than its expansion.
_MAX_FEATURES = 100
FORMULATIONS = ('per_joint', 'potential', 'chain')
# Formulations to choose from; `auto` chooses between chain and potential by the data.
CHOICES = ('auto', *FORMULATIONS)
ADDED, REMOVED, UPDATED = 'added', 'removed', 'updated'


@dataclass(frozen=True, eq=False)
class Coverage:
    """Trained range of a model: `q_min`, `q_max` (N,) in rad, number of samples and runs."""

    q_min: FloatArray
    q_max: FloatArray
    n_samples: int
    n_runs: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, 'q_min', np.asarray(self.q_min, dtype=np.float64))
        object.__setattr__(self, 'q_max', np.asarray(self.q_max, dtype=np.float64))

    @classmethod
    def of(cls, samples: JointSamples) -> Coverage:
        """Return the coverage of samples."""
        return cls(samples.q.min(axis=0), samples.q.max(axis=0), samples.n_samples,
                   len(np.unique(samples.runs)))

    def distance(self, q: FloatArray) -> FloatArray:
        """Return the distance (..., N) in rad of each joint of q from the trained range."""
        return np.maximum(np.maximum(self.q_min - q, q - self.q_max), 0.0)


@dataclass(frozen=True)
class Step:
    """
    One change of a model.

    `action` is 'added' or 'removed' for effects, 'updated' for a payload; `effects` are their
    targets (`payload` of an update), `when` the time as text. `before` and `after` are the
    held-out RMSE by joint in N·m, empty if not measured. `previous` is the model that an undo
    restores, None after the undo.
    """

    action: str
    effects: tuple[str, ...]
    when: str
    before: Mapping[str, float] = field(default_factory=dict)
    after: Mapping[str, float] = field(default_factory=dict)
    previous: GravityModel | None = None

    def __post_init__(self) -> None:
        if self.action not in (ADDED, REMOVED, UPDATED):
            raise DataError(f'history: unknown action {self.action!r}')


@dataclass(frozen=True, eq=False)
class GravityModel:
    """
    The gravity torque of an arm of N joints, learned from motion.

    `torques` are one expansion per joint in N·m; `energy` is the potential energy U in J with
    tau_n = dU/dq_n, None for `per_joint`. With an energy and no torques they are its gradient.
    `noise` (N,) is the residual's standard deviation in training, N·m; `provenance` contains data,
    options and solver, ready for JSON. `chain` is the chain from which the energy was expanded,
    None in other formulations. `covariance` is that of a step of the chain (`Chain.moved`), 4N
    parameters, or of the weights of the energy, followed by the coefficients of the effects
    `static` (as targets), which hold the joints together with gravity; None for `per_joint`.
    `applied` are effects in addition to gravity; `predict` returns gravity alone, and
    `effects.predict` adds them. `history` lists the changes of the model, the latest last.
    `fitted` are effects that were found in the fitted data and are not predicted: adding one moves
    it to `applied`. `residual_std` (N,)
    in N·m is the residual's standard deviation with all of them, None if it is that of the
    prediction. `payload_path` is the energy in J that a payload added; it determines how a load
    acts on the joints of an arm of unknown lengths (`estimation.payload_path`). `geometry` are the
    axes of the arm, if the chain was fitted on those of a description.

    :raises DataError: if the parts disagree in their number of joints or parameters, an effect is
        on an unknown joint, or a covariance is not finite.
    """

    joints: tuple[str, ...]
    formulation: str
    torques: tuple[Expansion, ...]
    energy: Expansion | None
    noise: FloatArray
    coverage: Coverage
    provenance: Mapping[str, Any] = field(default_factory=dict)
    chain: Chain | None = None
    covariance: FloatArray | None = None
    static: tuple[str, ...] = ()
    applied: Applied = Applied()
    history: tuple[Step, ...] = ()
    fitted: Applied = Applied()
    residual_std: FloatArray | None = None
    payload_path: Expansion | None = None
    geometry: Geometry | None = None

    def __post_init__(self) -> None:
        n = len(self.joints)
        if self.formulation not in FORMULATIONS:
            raise DataError(f'model: unknown formulation {self.formulation!r}; '
                            f'known: {", ".join(FORMULATIONS)}')
        object.__setattr__(self, 'joints', tuple(self.joints))
        object.__setattr__(self, 'noise', np.asarray(self.noise, dtype=np.float64))
        limit = dictionary.n_features(n)
        if self.energy is not None and not self.torques:
            object.__setattr__(self, 'torques', tuple(
                self.energy.gradient(n, joint) for joint in range(n)))
        by_joint = [self.noise, self.coverage.q_min, self.coverage.q_max,
                    *([] if self.residual_std is None else [self.residual_std])]
        sizes = {len(self.torques), *(len(values) for values in by_joint),
                 *([self.chain.n_joints] if self.chain else [])}
        if sizes != {n} or len(set(self.joints)) != n or any(each.ndim > 1 for each in by_joint):
            raise DataError(f'model: parts for {sorted(sizes)} joints, but {n} joint names')
        for part in (*self.torques, *(x for x in (self.energy, self.payload_path) if x)):
            if part.indices.size and part.indices[-1] >= limit:
                raise DataError(f'model: feature {part.indices[-1]} is outside the dictionary '
                                f'of {n} joints ({limit} features)')
        if self.geometry is not None and self.geometry.joints != self.joints:
            raise DataError(f'model: a geometry of {", ".join(self.geometry.joints)}, but joints '
                            f'{", ".join(self.joints)}')
        for effect in (*self.applied.effects, *self.fitted.effects):
            if effect.joint is not None and effect.joint not in self.joints:
                raise DataError(f'model: effect {effect.target} is on an unknown joint')
        if len(self.static_effects) < len(self.static):
            raise DataError(f'model: a covariance of effects that it does not have among '
                            f'{", ".join(self.static)}')
        if self.covariance is not None:
            object.__setattr__(self, 'covariance', self._checked(self.covariance))

    def _checked(self, covariance: FloatArray) -> FloatArray:
        array = np.asarray(covariance, dtype=np.float64)
        size = self._n_parameters + sum(len(e.coefficients) for e in self.static_effects)
        # JSON does not store the shape of an empty array.
        array = array if array.size else array.reshape(0, 0)
        if array.shape != (size, size):
            raise DataError(f'model: a covariance of {array.shape} for {size} parameters')
        if not np.isfinite(array).all():
            raise DataError('model: a covariance is not finite')
        return array

    @classmethod
    def from_energy(cls, joints: tuple[str, ...], formulation: str, energy: Expansion,
                    noise: FloatArray, coverage: Coverage, provenance: Mapping[str, Any],
                    chain: Chain | None = None,
                    covariance: FloatArray | None = None) -> GravityModel:
        """Return the model whose torque is the gradient of `energy`."""
        return cls(joints, formulation, (), energy, noise, coverage, provenance, chain,
                   covariance)

    @property
    def n_joints(self) -> int:
        return len(self.joints)

    @property
    def _n_parameters(self) -> int:
        """Return the number of parameters of gravity in the covariance."""
        if self.chain is not None:
            return 4 * self.chain.n_joints
        return 0 if self.energy is None else len(self.energy.indices)

    @property
    def static_effects(self) -> list[AppliedEffect]:
        """Return the effects whose coefficients are in the covariance, in their order."""
        every = {e.target: e for e in (*self.applied.effects, *self.fitted.effects)}
        return [every[target] for target in self.static if target in every]

    @property
    def covariance_given_effects(self) -> FloatArray:
        """Return the covariance (P, P) of gravity's parameters if the effects are exact."""
        assert self.covariance is not None
        p = self._n_parameters
        return self.covariance[:p, :p] - self._by_effects @ self.covariance[p:, :p]

    @property
    def covariance_of_effects(self) -> FloatArray:
        """Return the covariance (C, C) of the coefficients of the static effects."""
        assert self.covariance is not None
        p = self._n_parameters
        return self.covariance[p:, p:]

    @property
    def _by_effects(self) -> FloatArray:
        """Return the change (P, K) of gravity's parameters by the coefficients of effects."""
        assert self.covariance is not None
        p = self._n_parameters
        return lstsq(self.covariance_of_effects, self.covariance[p:, :p], rcond=1e-12).T

    def with_chain(self, chain: Chain, covariance: FloatArray) -> GravityModel:
        """
        Return the model with its chain changed by samples of which the effects were subtracted.

        :param covariance: of a step from the new chain (4N, 4N) at these effects.
        """
        joint = self.covariance
        if joint is not None:
            p, change = self._n_parameters, self._by_effects
            joint = joint.copy()
            joint[:p, :p] = covariance + change @ joint[p:, :p]
        return replace(self, torques=(), energy=expand(chain), chain=chain, covariance=joint)

    @property
    def noise_with_nuisance(self) -> FloatArray:
        """Return the residual's standard deviation (N,) in N·m with nuisance terms fitted."""
        return self.noise if self.residual_std is None else self.residual_std

    def predict(self, q: FloatArray) -> FloatArray:
        """
        Return the gravity torque (M, N) in N·m of poses q (M, N) in rad.

        :raises DataError: if q has another number of joints.
        """
        q, evaluator = self._poses(q), self._evaluator
        if self.chain is not None and len(evaluator.indices) > _MAX_FEATURES:
            return self.chain.torque(q)
        return dictionary.combined(q, evaluator.indices, evaluator.weights)

    def predict_one(self, q: FloatArray) -> FloatArray:
        """Return the gravity torque (N,) of one pose q (N,): `predict` for a control loop."""
        return self._evaluator(q)

    def predict_std(self, q: FloatArray) -> FloatArray:
        """
        Return the standard deviation (M, N) in N·m of `predict` at poses q (M, N).

        The covariance is propagated through the derivative of the torque by the parameters. This
        is exact for an energy, which is linear in its weights, and linearised for a chain. It
        excludes the measurement noise: 95 % of measured torques lie within
        1.96 sqrt(std^2 + noise^2).

        :raises DataError: if the model has no uncertainty, or q another number of joints.
        """
        q = self._poses(q)
        return np.concatenate([np.sqrt((self.deviations(q[rows]) ** 2).sum(axis=0))
                               for rows in batches(len(q))])

    def deviations(self, q: FloatArray) -> FloatArray:
        """
        Return changes (K, M, N) of `predict` at q (M, N), N·m; the squares sum to its variance.

        They are those by K independent errors of the parameters, of one standard deviation each.

        :raises DataError: if the model has no uncertainty.
        """
        if self.covariance is None:
            raise DataError(f'this {self.formulation} model has no uncertainty; fit it again '
                            f'as chain or potential')
        if self.chain is not None:
            columns = self.chain.jacobian(q)
        else:
            assert self.energy is not None
            columns = EnergyDesign(q, np.ones(q.shape)).columns(self.energy.indices).T
        spread = self._errors[:self._n_parameters].T @ columns.reshape(len(columns), q.size)
        return spread.reshape(-1, *q.T.shape).transpose(0, 2, 1)

    def coefficient_errors(self, effect: AppliedEffect) -> FloatArray:
        """Return the errors (C, K) of the coefficients of a static effect, as `deviations`."""
        start = self._n_parameters
        for each in self.static_effects:
            if each.target == effect.target:
                return self._errors[start:start + len(each.coefficients)]
            start += len(each.coefficients)
        return np.zeros((len(effect.coefficients), len(self._errors)))

    @cached_property
    def _errors(self) -> FloatArray:
        """Return the changes (P + C, K) of parameters and coefficients by independent errors."""
        assert self.covariance is not None
        return square_root(self.covariance)

    def _poses(self, q: FloatArray) -> FloatArray:
        q = np.atleast_2d(np.asarray(q, dtype=np.float64))
        if q.shape[1] != self.n_joints:
            raise DataError(f'model of {self.n_joints} joints was given poses of {q.shape[1]}')
        return q

    def n_features(self) -> IntArray:
        """Return the number of features of each joint's torque, shape (N,)."""
        return np.array([len(torque.indices) for torque in self.torques], dtype=np.int64)

    def extrapolation(self, q: FloatArray) -> float:
        """Return the largest distance in rad of a joint of pose q (N,) from the trained range."""
        return float(self.coverage.distance(q).max())

    def equation(self, joint: str, digits: int = 2) -> str:
        """
        Return a joint's torque in the notation of Yu 2022, Table B.1, the largest term first.

        E.g. `-20.81 s1 c2 + 3.10 s2`; `0` for a joint without features.

        :param digits: decimals, and significant digits of the largest weight at least.
        :raises DataError: if the joint is unknown.
        """
        if joint not in self.joints:
            raise DataError(f'no joint {joint} in the model; it has {", ".join(self.joints)}')
        terms = self.torques[self.joints.index(joint)]
        order = np.argsort(-np.abs(terms.weights), kind='stable')
        names = dictionary.feature_names(terms.indices[order], self.n_joints)
        largest = float(np.abs(terms.weights).max(initial=0.0)) or 1.0
        decimals = max(digits, digits - 1 - math.floor(math.log10(largest)))
        text = ''.join(f'{" - " if weight < 0 else " + "}{abs(weight):.{decimals}f} {name}'
                       for weight, name in zip(terms.weights[order].tolist(), names))
        return text[3:] if text.startswith(' + ') else text[1:].replace(' ', '', 1) or '0'

    @cached_property
    def _evaluator(self) -> _Evaluator:
        return _Evaluator(self.torques, self.n_joints)


class _Evaluator:
    """All joints' torques over the union of their features, in one product."""

    def __init__(self, torques: tuple[Expansion, ...], n_joints: int) -> None:
        every = np.concatenate([torque.indices for torque in torques])
        self.indices = np.unique(every).astype(np.int64)
        self.weights = np.zeros((len(self.indices), n_joints))
        for joint, torque in enumerate(torques):
            self.weights[np.searchsorted(self.indices, torque.indices), joint] = torque.weights
        choice = dictionary.digits(self.indices, n_joints)
        # Row k of the table is factor k of {1, sin, cos}: a flat index selects all at once.
        self._flat = np.ascontiguousarray((choice * n_joints + np.arange(n_joints)).T)

    def __call__(self, q: FloatArray) -> FloatArray:
        # A table of its own for each call: several threads use one model.
        table = np.ones((3, len(q)))
        np.sin(q, out=table[dictionary.SIN])
        np.cos(q, out=table[dictionary.COS])
        return np.multiply.reduce(table.take(self._flat), axis=0) @ self.weights
