"""
Whether the residual of the model in use is that of another payload.

Two explanations of a window of slow samples are compared. By the first the residual r is noise,
friction that has changed, offset, and what the model is unsure of; by the second a body on the
last link comes on top. Both are normal distributions of mean 0,

    S_0 = noise + A A.T,    S_1 = S_0 + B B.T,

A and B being columns of torque, each scaled by the standard deviation of its coefficient before
the samples. The evidence of either is a number, and either predicts a part of the window from the
rest of it. A contact that lasts a moment does not predict the rest. A push that lasts is told from
a weight by two more explanations. One adds a force along x and y of the base, which turns with the
arm otherwise than a weight does. In the other the torque b of the body varies with time, as no
hand holds its force,

    S_2 = S_1 + s^2 (b b.T) * K,    K_ij = exp(-|t_i - t_j| / T),

* being the product entry by entry: a weight has the same mass at every moment.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.nuisance import COULOMB, VISCOUS
from gravity_comp_ros.node.absolute_tests import reference_noise
from gravity_comp_ros.node.base_chain import changed_by_payload, without_friction
from gravity_comp_ros.node.live_friction import residual_noise, usual_residual
from gravity_comp_ros.node.payload import PARTS, PayloadFinding, PayloadLimits
from gravity_comp_ros.node.payload_test import axes_under, objections, PayloadEvidence
import numpy as np

# Slow samples that follow each other repeat the same model error: noise counts so many times.
_CORRELATED = 2.0
# Least difference of log evidence, nats: one to half a thousand million.
LEAST_EVIDENCE = 20.0
# By so much a body must explain more than a push. Payloads of 0.5 to 5 kg led by 11 to 54 in six
# seconds of motion; hardly any steady push of 10 N and more does.
LEAST_LEAD = 10.0
# A hand's force varies by this part of itself, within this time in s.
_UNSTEADY, _WITHIN = 0.3, 2.0
# By so much a steady body must explain more than one that varies. Payloads of 1 to 5 kg led by 10
# to 200 in sixteen seconds of motion, 0.5 kg by 5 to 50 in nine of ten.
LEAST_STEADY_LEAD = 3.0
# The share of the squared residual of each part of the window that the other parts must predict,
# and of its first and its last second: a body is there all the time.
LEAST_EXPLAINED, LEAST_AT_ENDS = 0.6, 0.3
_END = 1.0
# What is unknown of friction: this part of itself, as an offset that one, and the noise besides.
_FRICTION_PART, _OFFSET_PART = 0.5, 0.25
# rad/s; a viscous term makes a torque of the size of the residual at this speed.
_USUAL_SPEED = 0.1
_WIDTH = 0.01


def find_payload(samples: JointSamples, model: GravityModel, chain: GravityModel,
                 limits: PayloadLimits, geometry: Geometry | None = None) -> PayloadFinding:
    """
    Return whether these samples show another payload than that of the model.

    :param samples: slow samples at poses within the trained range, in order of time.
    :param model: in use. :param chain: the same gravity as a chain (`base_chain`).
    :param geometry: of the arm where it is known; it counts where the chain is on its axes.
    """
    geometry = axes_under(chain, geometry)
    gravity = replace(samples, tau=samples.tau - effect_torque(model, samples)
                      - nuisance_torque(model.nuisance, samples))
    window = _Window(gravity, samples.tau - gravity.tau, model, chain, limits, geometry)
    evidence, explained = window.evidence(), window.explained(
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
    push, varying = window.push(), window.varying(samples.t)
    values['log evidence of a push over a body'] = f'{push:.1f}'
    values['log evidence of a varying force over a body'] = f'{varying:.1f}'
    if evidence < LEAST_EVIDENCE or explained.min() < LEAST_EXPLAINED or (
            ends.min() < LEAST_AT_ENDS) or -LEAST_LEAD < push <= 0.0 or (
            -LEAST_STEADY_LEAD < varying <= 0.0):
        return PayloadFinding(False, False, f'no payload is suspected: {figures}', values)
    why = _objection(gravity, model, chain, limits, geometry)
    if why is None and push > 0.0:
        why = f'something pushes or pulls the last link, and not only downwards; {figures}'
    elif why is None and varying > 0.0:
        why = f'something bears on the last link with a force that varies; {figures}'
    if why is not None:
        return PayloadFinding(False, True, f'the effort has changed as no payload changes it: '
                              f'{why}', values)
    mass = values.get('mass [kg]')
    body = f'a change of {mass} kg on the last link' if mass else 'a body on the last link'
    return PayloadFinding(True, False, f'another payload is suspected: {body} explains at least '
                          f'{explained.min():.0%} of each third of the samples; {figures}', values)


def _objection(gravity: JointSamples, model: GravityModel, chain: GravityModel,
               limits: PayloadLimits, geometry: Geometry | None) -> str | None:
    """Return why a model of these samples would be refused, None if it would not be."""
    bare = without_friction(chain)
    noise = reference_noise(usual_residual(model), gravity, model.predict(gravity.q))
    found = PayloadEvidence(bare, changed_by_payload(bare, gravity), gravity, gravity, noise)
    return next(objections(found, limits, geometry), None)


class _Window:
    """The residual of a window and the columns of torque that may explain it."""

    def __init__(self, gravity: JointSamples, friction: FloatArray, model: GravityModel,
                 chain: GravityModel, limits: PayloadLimits, geometry: Geometry | None) -> None:
        self.residual = gravity.tau - model.predict(gravity.q)
        self.noise = residual_noise(model)
        self._geometry, self._shape = geometry, gravity.q.shape
        self._r = self.residual.T.ravel()
        body, *self._sideways = self._forces(chain, gravity.q, limits)
        friction_columns = self._friction(gravity, friction, model)
        unsure = self._unsure(chain, gravity.q)
        spread = np.repeat((_CORRELATED * self.noise) ** 2, len(gravity))
        self._s0 = np.diag(spread) + friction_columns.T @ friction_columns + unsure.T @ unsure
        self._s1 = self._s0 + body.T @ body
        self._columns = body

    def evidence(self) -> float:
        """Return the log evidence of a body over none."""
        return _log_evidence(self._s1, self._r) - _log_evidence(self._s0, self._r)

    def push(self) -> float:
        """Return the log evidence of a force in any direction over that of a body."""
        sideways = np.concatenate(self._sideways)
        return (_log_evidence(self._s1 + sideways.T @ sideways, self._r)
                - _log_evidence(self._s1, self._r))

    def varying(self, t: FloatArray) -> float:
        """Return the log evidence of a body whose torque varies with time t (M,) in s, over it."""
        body = self._columns.T @ (self._columns @ np.linalg.solve(self._s1, self._r))
        alike = np.exp(-np.abs(t[:, None] - t) / _WITHIN)
        unsteady = _UNSTEADY ** 2 * np.outer(body, body) * np.tile(alike, 2 * self._shape[1:])
        return _log_evidence(self._s1 + unsteady, self._r) - _log_evidence(self._s1, self._r)

    def explained(self, parts: np.ndarray) -> FloatArray:
        """Return the share of the squared residual of each part (P, M) that the rest predicts."""
        m, n = self._shape
        weight = np.repeat(self.noise ** -2, m)
        shares = []
        for part in parts:
            here = np.tile(part, n)
            error = float((weight[here] * _left_out(self._s1, self._r, here) ** 2).sum())
            shares.append(1.0 - error / float((weight[here] * self._r[here] ** 2).sum()))
        return np.array(shares)

    def mass(self) -> dict[str, str]:
        """Return the mass of the body in kg, signed, where lengths are known."""
        if self._geometry is None:
            return {}
        gain = np.linalg.solve(self._s1, self._columns.T).T
        mean = gain @ self._r
        std = np.sqrt(max(0.0, 1.0 - float(gain[0] @ self._columns[0])))
        return {'mass [kg]': f'{mean[0] * self._mass_scale:.3g}',
                'standard deviation of the mass [kg]': f'{std * self._mass_scale:.2g}'}

    def _forces(self, chain: GravityModel, q: FloatArray,
                limits: PayloadLimits) -> list[FloatArray]:
        """Return columns of a body on the last link, then of forces along x and y of the base."""
        assert chain.chain is not None
        kinematics = ForwardKinematics(chain.chain.axes, q)
        every = [kinematics.moment_columns(along).reshape(2 * q.shape[1], -1)
                 for along in (2, 0, 1)]
        if self._geometry is None:
            return [columns * float(np.abs(self.residual).max()) for columns in every]
        # The limit is two standard deviations away.
        self._mass_scale = 0.5 * limits.mass
        scale = self._mass_scale * np.array([1.0, *3 * [limits.reach]])
        return [scale[:, None] * (self._geometry.tool_moments() @ columns) for columns in every]

    def _friction(self, samples: JointSamples, friction: FloatArray,
                  model: GravityModel) -> FloatArray:
        """Return columns of friction and offset that may have changed since the training."""
        m, n = self._shape
        kinds = model.nuisance.of(COULOMB), model.nuisance.of(VISCOUS)
        width = model.nuisance.width if model.nuisance.width.size else np.full(n, _WIDTH)
        columns = np.zeros((3 * n, n, m))
        for k, name in enumerate(samples.names):
            coulomb, viscous = (abs(kind[name].value) if name in kind else 0.0 for kind in kinds)
            # Friction that is an effect of the model counts as well.
            size = max(coulomb, float(np.abs(friction[:, k]).max(initial=0.0)))
            columns[3 * k, k] = (self.noise[k] + _FRICTION_PART * size) * np.tanh(
                samples.qd[:, k] / width[k])
            columns[3 * k + 1, k] = samples.qd[:, k] * (
                self.noise[k] / _USUAL_SPEED + _FRICTION_PART * viscous)
            columns[3 * k + 2, k] = self.noise[k] + _OFFSET_PART * size
        return columns.reshape(3 * n, n * m)

    @staticmethod
    def _unsure(chain: GravityModel, q: FloatArray) -> FloatArray:
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


def _left_out(s: FloatArray, r: FloatArray, out: np.ndarray) -> FloatArray:
    """Return the error of the entries `out` as the others predict them."""
    others = ~out
    return np.asarray(r[out] - s[np.ix_(out, others)] @ np.linalg.solve(
        s[np.ix_(others, others)], r[others]))
