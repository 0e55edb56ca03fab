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

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import law_of, smooth_sign, speed_law
from gravity_comp_ros.evaluation.expected_residual import friction_size, rms, TYPICAL_SPEED
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.epoch import REST_SPEED
from gravity_comp_ros.node.parameters import Parameters
import numpy as np

# Number of parts of a window; a change must be present in each of them.
PARTS = 3
# Factor of the noise for the autocorrelated model error of consecutive slow samples.
_CORRELATED = 2.0
# Correlation time of the force of a hand, s, and its relative standard deviation.
_FORCE_TIME, _FORCE_STD = 2.0, 0.3
# Prior standard deviations of moments without known axes, relative to the largest residual.
_MOMENT_SCALES = (0.3, 1.0, 3.0, 10.0, 30.0)
# Prior standard deviations of a body on known axes, relative to half of the payload limits.
_BODY_SCALES = (0.01, 0.03, 0.1, 0.3, 1.0)
# Prior standard deviations relative to friction: of friction and of offset, both plus noise.
_FRICTION_STD, _OFFSET_STD = 0.5, 0.25
# Largest number of linearisations of a gain, and its change at which they end.
_MAX_STEPS, _CONVERGED = 10, 1e-3


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
    The fit of one hypothesis.

    `residual` (M, N) is in units of the noise; `mean` and `covariance` are of its own
    coefficients, in prior standard deviations.
    """

    log_evidence: float
    residual: FloatArray
    mean: FloatArray
    covariance: FloatArray

    def ratio(self, qd: FloatArray) -> FloatArray:
        """Return the RMS residual (N,) in units of the noise, of joints that move at qd (M, N)."""
        return moving_rms(self.residual, qd)


class Hypotheses:
    """
    The explanations of a window at one estimate of the axes.

    :param gravity: samples without the friction, offset and effects of the model.
    :param friction: the torque (M, N) of these, N·m.
    :param model: the model in use.
    :param chain: its gravity as a chain of the same joints, `covariance` that of a step from it.
    :param price: nats that every hypothesis of this table has less.
    :param noise: standard deviation (N,) of the residual of the model, N·m.
    :param geometry: the axes of the arm, None if they are unknown.
    """

    def __init__(self, gravity: JointSamples, friction: FloatArray, model: GravityModel,
                 chain: Chain, covariance: FloatArray, noise: FloatArray, limits: Parameters,
                 geometry: Geometry | None, price: float = 0.0) -> None:
        self.samples, self._noise, self._geometry = gravity, noise, geometry
        self.before = model.predict(gravity.q)
        self._sigma = _CORRELATED * noise
        self._r = self._white((gravity.tau - self.before).T[None])[0]
        self._limits, self._scale, self._price = limits, 1.0, price
        friction_columns = _friction_columns(gravity, friction, model, noise)

        def base(under: Chain) -> FloatArray:
            return self._white(np.concatenate((
                friction_columns, _uncertainty_columns(under, covariance, gravity.q))))

        self._base = base(chain)
        self._body, *self._horizontal = self._forces(chain, gravity.q)
        # The size of the body is that of the largest evidence: a light one is as likely as a
        # heavy one.
        self._scales = _MOMENT_SCALES if geometry is None else _BODY_SCALES
        fits = [self.explain(scale * self._body).log_evidence for scale in self._scales]
        self._scale = self._scales[int(np.argmax(fits))]
        self._body = self._scale * self._body
        self._horizontal = [self._scale * columns for columns in self._horizontal]
        # The uncertainty of an axis matters as much as the moments that it carries.
        change = self._moments(self.explain(self._body))
        self._loaded = base(chain.moved(np.concatenate((np.zeros_like(change), change))))
        # The fit of a body on the last link.
        self.carried = self.explain(self._body, base=self._loaded)

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
        n = self._noise.size
        residual = _CORRELATED * (r - mean @ design).reshape(n, -1).T
        k = len(own)
        return Explanation(evidence, residual, mean[:k], inverse[:k, :k])

    def push(self) -> Explanation:
        """Return the fit of a force in any direction on the last link."""
        return self.explain(self._body, *self._horizontal, base=self._loaded)

    def varying(self) -> Explanation:
        """Return the fit of a body whose torque varies in time, as the force of a hand does."""
        torque = self.carried.mean @ self._body
        t = self.samples.t - self.samples.t[0]
        knots = np.arange(0.0, t[-1] + _FORCE_TIME, _FORCE_TIME)
        hats = np.maximum(0.0, 1.0 - np.abs(t - knots[:, None]) / _FORCE_TIME)
        return self.explain(self._body, _FORCE_STD * np.tile(hats, self._noise.size) * torque,
                            base=self._loaded)

    def loaded_joints(self) -> list[int]:
        """Return the joints whose torque exceeds the noise; others have no gain to test."""
        return np.flatnonzero(rms(self.before) > self._noise).tolist()

    def gain(self, joint: int) -> Explanation:
        """Return the fit of another gain of one joint."""
        return max(self._gains(joint, self._body[:0], self._base), key=_evidence)

    def factor(self) -> Explanation:
        """Return the fit of a common factor of all joints, and constant torques."""
        return self.explain(self._fault(range(self._noise.size)))

    def body_and_gain(self, joint: int) -> Explanation:
        """Return the fit of a body and another gain of one joint, which comes first."""
        return max((fit for scale in self._scales for fit in self._gains(
            joint, scale / self._scale * self._body, self._loaded)), key=_evidence)

    def _gains(self, joint: int, body: FloatArray, base: FloatArray) -> Iterator[Explanation]:
        """
        Yield the fits of the columns of a body and the gain 1 + g of one joint: any, 0 and -1.

        Any gain includes a constant torque. The effort of the joint is (1 + g) (b + Bx), b the
        torque of the model and Bx that of the body, so that a dead joint does not measure the
        body either. The product is linearised at the last solution: the residual to explain is
        then r + g Bx, and its fit by the columns b + Bx and (1 + g) B is that of the product.
        """
        here = np.repeat(np.arange(self._noise.size) == joint, len(self.samples))
        fault, gain = self._fault([joint]), 0.0
        torque = np.zeros(self._r.size)
        own = fault[0].copy()
        for _ in range(_MAX_STEPS):
            fault[0] = own + torque
            fit = self.explain(fault, np.where(here, 1.0 + gain, 1.0) * body, base=base,
                               r=self._r + gain * torque)
            before, gain = gain, float(fit.mean[0])
            torque = np.where(here, fit.mean[len(fault):] @ body, 0.0)
            if abs(gain - before) < _CONVERGED:
                break
        yield fit
        for gain in (-1.0, -2.0):
            fit = self.explain(np.where(here, 1.0 + gain, 1.0) * body, base=base,
                               r=self._r - gain * own)
            yield replace(fit, mean=np.concatenate(([gain], fit.mean)))

    def _fault(self, joints: Sequence[int]) -> FloatArray:
        """Return the columns of one gain of some joints, and of a constant torque of each."""
        columns = np.zeros((1 + len(joints), *self.before.T.shape))
        for k, joint in enumerate(joints, 1):
            columns[0, joint] = self.before[:, joint]
            columns[k, joint] = np.abs(self.before[:, joint]).max()
        return self._white(columns)

    def without_joint(self, joint: int) -> tuple[float, FloatArray]:
        """
        Return the fit of a body to the other joints.

        :return: sum of the squared residuals of the others, and the torque (M,) in N·m of this
            joint that the fit predicts.
        """
        here = np.repeat(np.arange(self._noise.size) == joint, len(self.samples))
        predicted = self._body_without(here)
        error = (self._r - predicted)[~here]
        return float(error @ error), np.asarray(
            self.before[:, joint] + self._sigma[joint] * predicted[here])

    def explained(self, parts: Sequence[BoolArray]) -> FloatArray:
        """Return the share of the squared residual of each part (M,) that the rest predicts."""
        shares = []
        for part in parts:
            here = np.tile(part, self._noise.size)
            error, r = (self._r - self._body_without(here))[here], self._r[here]
            shares.append(1.0 - float(error @ error) / max(float(r @ r), 1e-30))
        return np.array(shares)

    def _body_without(self, here: BoolArray) -> FloatArray:
        """Return the torque (N·M,), whitened, of a body fitted to all rows but those of a mask."""
        design = np.concatenate((self._body, self._loaded))
        rest = design[:, ~here]
        return np.asarray(np.linalg.solve(
            np.eye(len(design)) + rest @ rest.T, rest @ self._r[~here]) @ design)

    def carried_body(self) -> tuple[float, float, float] | None:
        """Return mass and its standard deviation in kg, and reach in m; None without axes."""
        if self._geometry is None:
            return None
        scale, fit = self._body_scale(), self.carried
        mass, moment = fit.mean[0] * scale[0], fit.mean[1:4] * scale[1:]
        reach = float(np.linalg.norm(moment)) / max(abs(float(mass)), 1e-9)
        return float(mass), float(np.sqrt(fit.covariance[0, 0]) * scale[0]), reach

    def carried_moments(self) -> FloatArray:
        """Return the change (N,) of the moment of each link in N·m."""
        moments = self._moments(self.carried).reshape(-1, 2)
        return np.hypot(moments[:, 0], moments[:, 1])

    def _moments(self, fit: Explanation) -> FloatArray:
        """Return the change (2N,) of the moments of the chain in N·m."""
        if self._geometry is None:
            return fit.mean * self._scale * self._moment_scale()
        return np.asarray((fit.mean * self._body_scale()) @ self._geometry.tool_moments())

    def _white(self, columns: FloatArray) -> FloatArray:
        """Return columns (K, N, M) in N·m in units of the noise, as rows (K, N·M)."""
        return (columns / self._sigma[:, None]).reshape(len(columns), -1)

    def _body_scale(self) -> FloatArray:
        # The limit is two prior standard deviations.
        return 0.5 * self._scale * self._limits.max_payload * np.array(
            [1.0, *3 * [self._limits.max_payload_reach]])

    def _moment_scale(self) -> float:
        return float(np.abs(self.samples.tau - self.before).max()) + 1e-9

    def _forces(self, chain: Chain, q: FloatArray) -> list[FloatArray]:
        """Return columns of a body on the last link, then of forces along x and y of the base."""
        kinematics = ForwardKinematics(chain.axes, q)
        forces = [kinematics.moment_columns(along) for along in (2, 0, 1)]
        if self._geometry is None:
            return [self._white(self._moment_scale() * columns) for columns in forces]
        moments = self._body_scale()[:, None] * self._geometry.tool_moments()
        return [self._white(np.tensordot(moments, columns, axes=1)) for columns in forces]


def _evidence(fit: Explanation) -> float:
    return fit.log_evidence


def _friction_columns(samples: JointSamples, friction: FloatArray, model: GravityModel,
                      noise: FloatArray) -> FloatArray:
    """Return columns (3N, N, M) of friction and offset that may have changed."""
    m, n = samples.q.shape
    sizes = friction_size(model)
    laws = {effect.joint: speed_law(effect.setting, REST_SPEED) for effect in (
        *model.applied.effects, *model.fitted.effects) if law_of(effect.setting)}
    columns = np.zeros((n, 3, n, m))
    for k, name in enumerate(samples.names):
        # Includes a torque at rest.
        size = max(float(sizes[k]), float(np.abs(friction[:, k]).max(initial=0.0)))
        qd = samples.qd[:, k]
        columns[k, :, k] = [
            (noise[k] + _FRICTION_STD * size) * smooth_sign(
                qd, laws.get(name, {'width': REST_SPEED})),
            (noise[k] + _FRICTION_STD * size) * qd / TYPICAL_SPEED,
            np.full(m, noise[k] + _OFFSET_STD * size)]
    return columns.reshape(3 * n, n, m)


def _uncertainty_columns(chain: Chain, covariance: FloatArray, q: FloatArray) -> FloatArray:
    """Return columns (K, N, M) whose outer product is the covariance of the chain's torque."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.tensordot(root.T, chain.jacobian(q), axes=1)


def gain_of(measured: FloatArray, expected: FloatArray) -> str:
    """Return the probable fault of a joint from its measured and expected torque (M,), N·m."""
    power = float((expected ** 2).sum())
    slope = float((measured * expected).sum()) / power if power > 0.0 else 1.0
    if slope < -0.5:
        return 'has the wrong sign'
    if measured.std() < 0.25 * expected.std():
        return 'is dead or frozen'
    return 'measures the torque of another joint, or has a wrong gain'
