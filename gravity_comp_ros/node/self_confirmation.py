"""
Self-confirmation: measured effort that is the node's own output.

An arm that floats on the published torque and is guided by hand measures the published torque,
whatever its payload. On such samples any model confirms itself. The node therefore records the
torque published before each sample, and accepts a new model only if it explains the effort better
than the published torque does. Friction is excluded from the comparison: a position controller
that adds friction torque to the published torque may otherwise hide a light payload.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.node.live_nuisance import rms
import numpy as np

# Possible delays of a driver from command to reported effort, s.
DELAYS = (0.0, 0.004, 0.01, 0.02, 0.05, 0.1, 0.2)
# Maximum number of torques kept; at least half of them, enough for the longest delay at 2 kHz.
_MAX_TORQUES = 2000
# Minimum share of the samples that were recorded while torque was published.
_MIN_SHARE = 0.5
# Published torque that supports no arm, RMS over all joints, N·m.
_NEGLIGIBLE = 0.05
# Largest ratio of the model's residual to that of the published torque.
_MAX_RATIO = 0.9
# Speed over which friction changes its sign, rad/s.
_WIDTH = 0.01
# Minimum variation of the published torque of a joint, as a fraction of the largest variation.
_MIN_VARIATION = 0.02


class SentTorqueHistory:
    """The recently published torques."""

    def __init__(self, n_joints: int) -> None:
        self._times: list[float] = []
        self._torques: list[FloatArray] = []
        self._none = np.full(n_joints, np.nan)

    def published(self, now: float, tau: FloatArray) -> None:
        """Record a published torque (N,)."""
        times, torques = self._times, self._torques
        if times and now < times[-1]:
            times.clear()
            torques.clear()
        elif len(times) >= _MAX_TORQUES:
            del times[:_MAX_TORQUES // 2], torques[:_MAX_TORQUES // 2]
        times.append(now)
        torques.append(tau)

    def before(self, now: float) -> FloatArray:
        """
        Return the last torque published before now minus each of `DELAYS` (D, N); NaN for none.

        The torque published at `now` is the response to the sample and is not included.
        """
        places = [bisect_left(self._times, now - delay) - 1 for delay in DELAYS]
        return np.array([self._torques[k] if k >= 0 else self._none for k in places])


@dataclass(frozen=True, eq=False)
class SentTorque:
    """The published torque of the samples of a job, (M, D, N) each, NaN where there was none."""

    train: FloatArray
    held_out: FloatArray


def echo_objection(sent: SentTorque, train: JointSamples, held_out: JointSamples,
                   new_train: FloatArray, new_held_out: FloatArray,
                   has_new_effects: bool = False) -> str | None:
    """
    Return why these samples are an echo of the published torque, None if they are not.

    :param new_train: torque of the new model at the samples (M, N), N·m; `new_held_out` likewise.
    :param has_new_effects: whether the new model has other effects; friction is then compared.
    """
    torque = np.concatenate((sent.train, sent.held_out))
    tau = np.concatenate((train.tau, held_out.tau))
    known = np.isfinite(torque).all(axis=(1, 2))
    if known.mean() < _MIN_SHARE or known.sum() < 5:
        return None
    torque, tau = torque[known], tau[known]
    if float(np.sqrt((torque ** 2).mean())) < _NEGLIGIBLE:
        return None
    qd = np.concatenate((train.qd, held_out.qd))[known]
    errors = [tau - np.concatenate((new_train, new_held_out))[known],
              *(tau - torque[:, k] for k in range(len(DELAYS)))]
    if not has_new_effects:
        errors = [_without_friction(error, qd) for error in errors]
    model_rms, *sent_rms = (rms(error) for error in errors)
    spread = torque[:, 0].std(axis=0)
    counts = spread > _MIN_VARIATION * float(spread.max(initial=0.0))
    echo_rms = [float(np.sqrt((each[counts] ** 2).mean())) for each in sent_rms]
    best = int(np.argmin(echo_rms))
    new = float(np.sqrt((model_rms[counts] ** 2).mean()))
    if new < _MAX_RATIO * echo_rms[best]:
        return None
    return ('the effort is the torque that this node published '
            f'{1e3 * DELAYS[best]:.0f} ms before: RMS difference {echo_rms[best]:.3g} N·m, '
            f'residual of the new model {new:.3g} N·m. Either the model in use is right already, '
            'or the arm floats on that torque and is guided by hand, which gives no new data: '
            'move it by its own controller')


def _without_friction(residual: FloatArray, qd: FloatArray) -> FloatArray:
    """Return a residual (M, N) minus its least-squares Coulomb and viscous friction."""
    result = np.empty_like(residual)
    for n in range(residual.shape[1]):
        columns = np.column_stack([np.tanh(qd[:, n] / _WIDTH), qd[:, n]])
        coefficients = lstsq(columns, residual[:, n])
        result[:, n] = residual[:, n] - columns @ coefficients
    return result
