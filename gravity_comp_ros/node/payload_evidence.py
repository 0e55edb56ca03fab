"""
Bayesian test of the residual of the model in use for another payload.

Two explanations of the residual r of a window of slow samples are compared. Without a payload r is
noise, changed friction, offset and the uncertainty of the model. With a payload the torque of a
body on the last link is added. Both are normal distributions of mean 0,

    S_0 = noise + A A.T,    S_1 = S_0 + B B.T,

where A and B are columns of torque, each scaled by the prior standard deviation of its
coefficient. The criteria are the difference of the log evidence, and the prediction of a part of
the window from the rest of it, which fails for a short contact. Two more explanations distinguish
a lasting push from a weight. The first adds a horizontal force, whose torque depends on the pose
in another way than that of a weight. In the second the torque b of the body varies with time, as
the force of a hand does,

    S_2 = S_1 + s^2 (b b.T) * K,    K_ij = exp(-|t_i - t_j| / T),

where * is the product entry by entry; the mass of a weight is constant.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.nuisance import COULOMB, VISCOUS
from gravity_comp_ros.node.base_chain import changed_by_payload, without_friction
from gravity_comp_ros.node.effort_plausibility import reference_noise
from gravity_comp_ros.node.live_nuisance import (
    expected_residual, residual_noise, without_nuisance)
from gravity_comp_ros.node.payload import PARTS, PayloadFinding, PayloadLimits
from gravity_comp_ros.node.payload_test import axes_under, objections, PayloadEvidence
import numpy as np

# Factor of the noise for the autocorrelated model error of consecutive slow samples.
_CORRELATED = 2.0
# Minimum difference of log evidence of a body, nats: odds of 5e8 to 1.
MIN_EVIDENCE = 20.0
# Minimum log evidence of a body over a push, nats. Payloads of 0.5 to 5 kg had 11 to 54 in six
# seconds of motion; hardly any steady push of 10 N and more had 10.
MIN_LEAD_OVER_PUSH = 10.0
# Relative standard deviation of the force of a hand, and its correlation time, s.
_FORCE_STD, _FORCE_TIME = 0.3, 2.0
# Minimum log evidence of a steady body over a varying force, nats. Payloads of 1 to 5 kg had 10 to
# 200 in sixteen seconds of motion, 0.5 kg had 5 to 50 in nine of ten.
MIN_LEAD_OVER_VARYING = 3.0
# Minimum share of the squared residual of each part of the window that the other parts predict,
# and the same for its first and last second, because a body is present all the time.
MIN_EXPLAINED, MIN_EXPLAINED_AT_ENDS = 0.6, 0.3
_END = 1.0
# Prior standard deviations relative to friction: of friction and of offset, both plus noise.
_FRICTION_STD, _OFFSET_STD = 0.5, 0.25
# Speed at which the prior torque of a viscous term is that of the noise, rad/s.
_TYPICAL_SPEED = 0.1
# Speed over which friction changes its sign where the model has no width, rad/s.
_WIDTH = 0.01


def find_payload(samples: JointSamples, model: GravityModel, chain: GravityModel,
                 limits: PayloadLimits, geometry: Geometry | None = None) -> PayloadFinding:
    """
    Return whether these samples show another payload than that of the model.

    :param samples: slow samples at poses within the trained range, in order of time.
    :param model: the model in use.
    :param chain: the same gravity as a chain (`base_chain`).
    :param geometry: axes of the arm where they are known; used if the chain has these axes.
    """
    geometry = axes_under(chain, geometry)
    others = effect_torque(model, samples) + nuisance_torque(model.nuisance, samples)
    gravity = without_nuisance(model, samples, others)
    window = _Window(gravity, others, model, chain, limits, geometry)
    evidence = window.body_evidence()
    explained = window.explained(
        np.arange(len(samples)) * PARTS // len(samples) == np.arange(PARTS)[:, None])
    ends = window.explained(np.array([samples.t <= samples.t[0] + _END,
                                      samples.t >= samples.t[-1] - _END]))
    residual = np.sqrt((window.residual ** 2).mean(axis=0))
    worst = int(np.argmax(residual / window.noise))
    values = {
        'joint': samples.names[worst], 'residual [Nm]': f'{residual[worst]:.3g}',
        'noise of the training [Nm]': f'{window.noise[worst]:.3g}',
        'log evidence': f'{evidence:.1f}', 'least part explained': f'{explained.min():.3f}',
        'least end explained': f'{ends.min():.3f}',
        'samples': str(len(samples)), 'from [s]': f'{samples.t[0]:.3f}',
        'to [s]': f'{samples.t[-1]:.3f}', **window.mass()}
    figures = (f'residual of {samples.names[worst]} {residual[worst]:.3g} N·m, noise of the '
               f'training {window.noise[worst]:.3g}, {len(samples)} samples in '
               f'{samples.t[-1] - samples.t[0]:.1f} s')
    push, varying = window.push_evidence(), window.varying_evidence(samples.t)
    values['log evidence of a push over a body'] = f'{push:.1f}'
    values['log evidence of a varying force over a body'] = f'{varying:.1f}'
    if evidence < MIN_EVIDENCE or explained.min() < MIN_EXPLAINED or (
            ends.min() < MIN_EXPLAINED_AT_ENDS) or -MIN_LEAD_OVER_PUSH < push <= 0.0 or (
            -MIN_LEAD_OVER_VARYING < varying <= 0.0):
        return PayloadFinding(False, False, f'no payload is suspected: {figures}', values)
    why = _objection(gravity, model, chain, limits, geometry)
    if why is None and push > 0.0:
        why = f'something pushes or pulls the last link, not only downwards; {figures}'
    elif why is None and varying > 0.0:
        why = f'a varying force acts on the last link; {figures}'
    if why is not None:
        return PayloadFinding(False, True, 'the effort has changed in a way that no payload '
                              f'explains: {why}', values)
    mass = values.get('mass [kg]')
    body = f'a change of {mass} kg on the last link' if mass else 'a body on the last link'
    return PayloadFinding(True, False, f'another payload is suspected: {body} explains at least '
                          f'{explained.min():.0%} of each third of the samples; {figures}', values)


def _objection(gravity: JointSamples, model: GravityModel, chain: GravityModel,
               limits: PayloadLimits, geometry: Geometry | None) -> str | None:
    """Return why a model of these samples would be refused, None if it would not be."""
    bare = without_friction(chain)
    noise = reference_noise(expected_residual(model), gravity, model.predict(gravity.q))
    change = PayloadEvidence(bare, changed_by_payload(bare, gravity), gravity, gravity, noise)
    return next(objections(change, limits, geometry), None)


class _Window:
    """The residual of a window and the covariances of its explanations."""

    def __init__(self, gravity: JointSamples, friction: FloatArray, model: GravityModel,
                 chain: GravityModel, limits: PayloadLimits, geometry: Geometry | None) -> None:
        self.residual = gravity.tau - model.predict(gravity.q)
        self.noise = residual_noise(model)
        self._geometry, self._shape = geometry, gravity.q.shape
        self._r = self.residual.T.ravel()
        self._body, *self._horizontal = self._forces(chain, gravity.q, limits)
        friction_columns = self._friction(gravity, friction, model)
        uncertain = self._uncertainty(chain, gravity.q)
        variance = np.repeat((_CORRELATED * self.noise) ** 2, len(gravity))
        self._s0 = (np.diag(variance) + friction_columns.T @ friction_columns
                    + uncertain.T @ uncertain)
        self._s1 = self._s0 + self._body.T @ self._body

    def body_evidence(self) -> float:
        """Return the log evidence of a body over none."""
        return _log_evidence(self._s1, self._r) - _log_evidence(self._s0, self._r)

    def push_evidence(self) -> float:
        """Return the log evidence of a force in any direction over that of a body."""
        horizontal = np.concatenate(self._horizontal)
        return (_log_evidence(self._s1 + horizontal.T @ horizontal, self._r)
                - _log_evidence(self._s1, self._r))

    def varying_evidence(self, t: FloatArray) -> float:
        """Return the log evidence of a varying force over that of a body; t (M,) in s."""
        body = self._body.T @ (self._body @ np.linalg.solve(self._s1, self._r))
        correlation = np.exp(-np.abs(t[:, None] - t) / _FORCE_TIME)
        varying = (_FORCE_STD ** 2 * np.outer(body, body)
                   * np.tile(correlation, 2 * self._shape[1:]))
        return _log_evidence(self._s1 + varying, self._r) - _log_evidence(self._s1, self._r)

    def explained(self, parts: np.ndarray) -> FloatArray:
        """Return the share of the squared residual of each part (P, M) that the rest predicts."""
        m, n = self._shape
        weight = np.repeat(self.noise ** -2, m)
        shares = []
        for part in parts:
            here = np.tile(part, n)
            error = float((weight[here] * _cross_residual(self._s1, self._r, here) ** 2).sum())
            shares.append(1.0 - error / float((weight[here] * self._r[here] ** 2).sum()))
        return np.array(shares)

    def mass(self) -> dict[str, str]:
        """Return the mass of the body in kg, signed, where lengths are known."""
        if self._geometry is None:
            return {}
        gain = np.linalg.solve(self._s1, self._body.T).T
        mean = gain @ self._r
        std = np.sqrt(max(0.0, 1.0 - float(gain[0] @ self._body[0])))
        return {'mass [kg]': f'{mean[0] * self._mass_scale:.3g}',
                'standard deviation of the mass [kg]': f'{std * self._mass_scale:.2g}'}

    def _forces(self, chain: GravityModel, q: FloatArray,
                limits: PayloadLimits) -> list[FloatArray]:
        """Return columns of a body on the last link, then of forces along x and y of the base."""
        assert chain.chain is not None
        kinematics = ForwardKinematics(chain.chain.axes, q)
        forces = [kinematics.moment_columns(along).reshape(2 * q.shape[1], -1)
                  for along in (2, 0, 1)]
        if self._geometry is None:
            return [columns * float(np.abs(self.residual).max()) for columns in forces]
        # The limit is two prior standard deviations.
        self._mass_scale = 0.5 * limits.mass
        scale = self._mass_scale * np.array([1.0, *3 * [limits.reach]])
        return [scale[:, None] * (self._geometry.tool_moments() @ columns) for columns in forces]

    def _friction(self, samples: JointSamples, friction: FloatArray,
                  model: GravityModel) -> FloatArray:
        """Return columns of friction and offset that may have changed since the training."""
        m, n = self._shape
        kinds = model.nuisance.of(COULOMB), model.nuisance.of(VISCOUS)
        width = model.nuisance.width if model.nuisance.width.size else np.full(n, _WIDTH)
        columns = np.zeros((3 * n, n, m))
        for k, name in enumerate(samples.names):
            coulomb, viscous = (abs(kind[name].value) if name in kind else 0.0 for kind in kinds)
            # Includes friction that is an effect of the model.
            size = max(coulomb, float(np.abs(friction[:, k]).max(initial=0.0)))
            columns[3 * k, k] = (self.noise[k] + _FRICTION_STD * size) * np.tanh(
                samples.qd[:, k] / width[k])
            columns[3 * k + 1, k] = samples.qd[:, k] * (
                self.noise[k] / _TYPICAL_SPEED + _FRICTION_STD * viscous)
            columns[3 * k + 2, k] = self.noise[k] + _OFFSET_STD * size
        return columns.reshape(3 * n, n * m)

    @staticmethod
    def _uncertainty(chain: GravityModel, q: FloatArray) -> FloatArray:
        """Return columns whose outer product is the covariance of the chain's torque."""
        assert chain.chain is not None
        if chain.uncertainty is None:
            return np.zeros((0, q.size))
        values, vectors = np.linalg.eigh(chain.uncertainty.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        jacobian = chain.chain.jacobian(q).reshape(len(root), -1)
        return np.asarray(root.T @ jacobian)


def _log_evidence(s: FloatArray, r: FloatArray) -> float:
    lower = np.linalg.cholesky(s)
    white = np.linalg.solve(lower, r)
    return -0.5 * float(white @ white) - float(np.log(np.diag(lower)).sum())


def _cross_residual(s: FloatArray, r: FloatArray, out: np.ndarray) -> FloatArray:
    """Return the residual of the entries `out` as predicted from the others."""
    others = ~out
    return np.asarray(r[out] - s[np.ix_(out, others)] @ np.linalg.solve(
        s[np.ix_(others, others)], r[others]))
