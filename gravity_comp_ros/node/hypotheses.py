"""
Hypotheses that explain a window of samples: unchanged, a body, a push, a fault of a joint.

The torque r (M, N) that the model in use does not predict is explained by columns A of torque,
each scaled by the prior standard deviation of its coefficient, and by noise. Every hypothesis is
such a set of columns (docs/node.md lists them); each includes those of H0: friction and offset
that have changed, and the uncertainty of the model.

With whitened rows the log evidence of a hypothesis is

    L = -1/2 (r'r - b'G^-1 b) - 1/2 log|G|,    G = I + A A',  b = A r,

of which only differences count. The residual after the fit of a hypothesis, in units of the
noise, shows whether it explains the samples at all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
import math
from operator import attrgetter

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import law_of, smooth_sign, speed_law
from gravity_comp_ros.estimation.chain_update import NewSamples, Trial
from gravity_comp_ros.estimation.update import payload_change_weights
from gravity_comp_ros.estimation.update_step import changed_model
from gravity_comp_ros.evaluation.expected_residual import friction_size, RESIDUAL, rms
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.least_squares import square_root
from gravity_comp_ros.node.epoch import REST_SPEED
from gravity_comp_ros.node.options import CHECKS
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np

_EVIDENCE = attrgetter('log_evidence')


def moving(qd: FloatArray) -> BoolArray:
    """
    Return a mask (M, N) of the samples with speed qd that count as motion.

    At rest friction has any value between its two directions, which no model predicts. All
    samples count for a joint that is at rest most of the time.
    """
    moves = np.abs(qd) > REST_SPEED
    return np.asarray(moves | (moves.mean(axis=0) < 0.5))


def moving_rms(residual: FloatArray, qd: FloatArray) -> FloatArray:
    """Return the RMS (N,) in N·m of a residual (M, N) over the samples in `moving`."""
    moves = moving(qd)
    return np.asarray(np.sqrt((moves * residual ** 2).sum(axis=0) / moves.sum(axis=0)))


@dataclass(frozen=True, eq=False)
class Explanation:
    """
    The fit of one hypothesis, with its residual (M, N) in units of the noise.

    `mean` and `covariance` are of its own coefficients, in prior standard deviations.
    """

    log_evidence: float
    residual: FloatArray
    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class Window:
    """
    The input of all hypotheses about a window of samples.

    The `samples` are without the friction, offset and effects of the model, which are `friction`
    (M, N) in N·m. `chain` is the gravity of the `model` in use as a chain of the same joints.
    `noise` (N,) is the standard deviation of the residual of the model, N·m, `reference` (N,) that
    with the drift of friction and with the noise of the samples. The `settings` have the limits of
    a payload; `geometry` is None if the axes of the arm are unknown.
    """

    samples: JointSamples
    friction: FloatArray
    model: GravityModel
    chain: GravityModel
    noise: FloatArray
    reference: FloatArray
    settings: Parameters
    geometry: Geometry | None

    def tables(self) -> list[Hypotheses]:
        """
        Return the explanations of the window, the table of the most probable body first.

        The direction of an axis that carried nothing before is not identified. Each direction
        that a sparse update finds probable has a table of its own.
        """
        chain, samples = self.chain, self.samples
        assert chain.chain is not None
        n = chain.n_joints
        covariance = (np.zeros((4 * n, 4 * n)) if chain.covariance is None
                      else chain.covariance_given_effects)
        trials = [Trial(chain.chain, covariance)]
        if self.geometry is None:
            trials += changed_model(chain, NewSamples(
                samples.q, samples.tau, self.noise, payload_change_weights(chain, samples)),
                None).trials
        return sorted((Hypotheses(self, trial) for trial in trials),
                      key=lambda table: -table.carried.log_evidence)


class Hypotheses:
    """The explanations of a window at one estimate of the axes, the chain of `trial`."""

    def __init__(self, window: Window, trial: Trial) -> None:
        self.window, samples, geometry = window, window.samples, window.geometry
        self.before = window.model.predict(samples.q)
        self._n, self._price = window.noise.size, trial.price
        self._sigma = CHECKS.correlated * window.noise
        self._r = self._white((samples.tau - self.before).T[None])[0]
        friction_columns = _friction_columns(window)

        def base(under: Chain) -> FloatArray:
            return self._white(np.concatenate((
                friction_columns, _uncertainty_columns(under, trial.prior, samples.q))))

        self._base = base(trial.chain)
        # Moments (K, 2N) in N·m of one prior standard deviation of each coefficient of a body.
        largest = CHECKS.moment * float(np.abs(samples.tau - self.before).max()) + 1e-9
        moments = (largest * np.eye(2 * self._n) if geometry is None
                   else self._units()[:, None] * geometry.tool_moments())
        kinematics = ForwardKinematics(trial.chain.axes, samples.q)
        # Columns of a body on the last link, then of forces along x and y of the base.
        forces = [self._white(np.tensordot(moments, kinematics.moment_columns(along), axes=1))
                  for along in (2, 0, 1)]
        # The size of the body is that of the largest evidence: a light one is as likely as a
        # heavy one.
        self._scale = max(CHECKS.body,
                          key=lambda scale: self.explain(scale * forces[0]).log_evidence)
        self._body, *self._horizontal = (self._scale * columns for columns in forces)
        # The uncertainty of an axis matters as much as the moments that it carries.
        change = self.explain(self._body).mean @ (self._scale * moments)
        self._loaded = base(trial.chain.moved(np.concatenate((np.zeros_like(change), change))))
        # The fit of a body on the last link, and its moments (N, 2) in N·m.
        self.carried = self.explain(self._body, base=self._loaded)
        self.moments = (self.carried.mean @ (self._scale * moments)).reshape(-1, 2)

    def explain(self, *columns: FloatArray, base: FloatArray | None = None,
                r: FloatArray | None = None) -> Explanation:
        """
        Return the fit of the hypothesis with these columns (K, N·M), whitened.

        :param base: columns of H0 if other than those of the model in use.
        :param r: torque (N·M,) to explain, whitened, if other than that of the window.
        """
        own = np.concatenate(columns) if columns else np.zeros((0, self._r.size))
        base = self._base if base is None else base
        r = self._r if r is None else r
        design = np.concatenate((own, base))
        gram = np.eye(len(design)) + design @ design.T
        inverse = np.linalg.inv(gram)
        projection = design @ r
        mean = inverse @ projection
        evidence = (-0.5 * float(r @ r - projection @ mean)
                    - 0.5 * float(np.linalg.slogdet(gram)[1])) - self._price
        residual = CHECKS.correlated * (r - mean @ design).reshape(self._n, -1).T
        k = len(own)
        return Explanation(evidence, residual, mean[:k], inverse[:k, :k])

    def ratio(self, fit: Explanation) -> FloatArray:
        """Return the RMS residual (N,) of a fit in units of the reference noise, in motion."""
        return moving_rms(fit.residual, self.window.samples.qd) * (
            self.window.noise / self.window.reference)

    def push(self) -> Explanation:
        """Return the fit of a force in any direction on the last link."""
        return self.explain(self._body, *self._horizontal, base=self._loaded)

    def varying(self) -> Explanation:
        """Return the fit of a body whose torque varies in time, as the force of a hand does."""
        torque, t = self.carried.mean @ self._body, self.window.samples.t
        time = CHECKS.force_time
        knots = np.arange(t[0], t[-1] + time, time)
        hats = np.maximum(0.0, 1.0 - np.abs(t - knots[:, None]) / time)
        return self.explain(self._body, CHECKS.force * np.tile(hats, self._n) * torque,
                            base=self._loaded)

    def faults(self) -> Iterator[tuple[Explanation, str]]:
        """
        Yield the faults: a common factor, and the gain of a joint, with a body or without.

        A joint whose torque does not exceed the noise has no gain to test.

        :return: the fit, whose first coefficient is the change of the gain, and a sentence.
        """
        fits = [(self.explain(self._fault(range(self._n))), 'all joints',
                 'another unit or gain, no payload')]
        fits += [(self.gain_of(k), self.window.samples.names[k],
                  'its sensor or its drive is faulty')
                 for k in np.flatnonzero(rms(self.before) > self.window.noise).tolist()]
        for fit, name, why in fits:
            yield fit, (f'the effort of {name} is {1.0 + fit.mean[0]:.3g} times the earlier one: '
                        f'{why}')

    def gain_of(self, joint: int) -> Explanation:
        """Return the best fit of another gain of a joint, which comes first, and of a body."""
        return max((self._gain(joint, scale / self._scale * self._body)
                    for scale in (0.0, *CHECKS.body)), key=_EVIDENCE)

    def _gain(self, joint: int, body: FloatArray) -> Explanation:
        """
        Return the best fit of the columns of a body and the gain 1 + g of a joint: any, 0 or -1.

        Any gain includes a constant torque. The effort of the joint is (1 + g) (b + Bx), b the
        torque of the model and Bx that of the body, so that a dead joint does not measure the
        body either. The product is linearised at the last solution: the residual to explain is
        then r + g Bx, and its fit by the columns b + Bx and (1 + g) B is that of the product.
        """
        here, gain, base = self._rows_of(joint), 0.0, self._loaded
        fault, torque = self._fault([joint]), np.zeros(self._r.size)
        own = fault[0].copy()
        for _ in range(EngineOptions().steps):
            fault[0] = own + torque
            fit = self.explain(fault, np.where(here, 1.0 + gain, 1.0) * body, base=base,
                               r=self._r + gain * torque)
            before, gain = gain, float(fit.mean[0])
            torque = np.where(here, fit.mean[len(fault):] @ body, 0.0)
            if abs(gain - before) < CHECKS.converged:
                break
        fits = [fit]
        for gain in (-1.0, -2.0):
            fit = self.explain(np.where(here, 1.0 + gain, 1.0) * body, base=base,
                               r=self._r - gain * own)
            fits.append(replace(fit, mean=np.concatenate(([gain], fit.mean))))
        return max(fits, key=_EVIDENCE)

    def _fault(self, joints: Sequence[int]) -> FloatArray:
        """Return the columns of one gain of some joints, and of a constant torque of each."""
        columns = np.zeros((1 + len(joints), *self.before.T.shape))
        for k, joint in enumerate(joints, 1):
            columns[0, joint] = self.before[:, joint]
            columns[k, joint] = np.abs(self.before[:, joint]).max()
        return self._white(columns)

    def most_faulty(self) -> int:
        """Return the joint without which a body fits best."""
        def misfit(joint: int) -> float:
            others = ~self._rows_of(joint)
            fit = self.explain(self._body * others, base=self._loaded * others,
                               r=self._r * others)
            return float((fit.residual ** 2).sum())

        return min(range(self._n), key=misfit)

    def body(self) -> tuple[float, float, float] | None:
        """Return mass and its standard deviation in kg, and reach in m; None without axes."""
        if self.window.geometry is None:
            return None
        fit, units = self.carried, self._scale * self._units()
        mass, *moment = (fit.mean * units).tolist()
        return (mass, float(np.sqrt(fit.covariance[0, 0])) * units[0],
                math.hypot(*moment) / max(abs(mass), 1e-9))

    def _units(self) -> FloatArray:
        """Return mass (kg) and moments (kg m) of one prior standard deviation: half the limits."""
        limits = self.window.settings
        return 0.5 * limits.max_payload * np.array([1.0, *3 * [limits.max_payload_reach]])

    def _rows_of(self, joint: int) -> BoolArray:
        """Return a mask (N·M,) of the rows of a joint."""
        return np.repeat(np.arange(self._n) == joint, len(self.window.samples))

    def _white(self, columns: FloatArray) -> FloatArray:
        """Return columns (K, N, M) in N·m in units of the noise, as rows (K, N·M)."""
        return (columns / self._sigma[:, None]).reshape(len(columns), -1)


def _friction_columns(window: Window) -> FloatArray:
    """Return columns (3N, N, M) of friction and offset that may have changed."""
    samples, model, noise = window.samples, window.model, window.noise
    m, n = samples.q.shape
    # Includes a torque at rest.
    sizes = np.maximum(friction_size(model), np.abs(window.friction).max(axis=0, initial=0.0))
    laws = {effect.joint: speed_law(effect.setting, REST_SPEED) for effect in (
        *model.applied.effects, *model.fitted.effects) if law_of(effect.setting)}
    columns = np.zeros((n, 3, n, m))
    for k, name in enumerate(samples.names):
        qd, size = samples.qd[:, k], noise[k] + RESIDUAL.drift * sizes[k]
        columns[k, :, k] = [
            size * smooth_sign(qd, laws.get(name, {'width': REST_SPEED})),
            size * qd / RESIDUAL.speed, np.full(m, size)]
    return columns.reshape(3 * n, n, m)


def _uncertainty_columns(chain: Chain, covariance: FloatArray, q: FloatArray) -> FloatArray:
    """Return columns (K, N, M) whose outer product is the covariance of the chain's torque."""
    return np.tensordot(square_root(covariance).T, chain.jacobian(q), axes=1)
