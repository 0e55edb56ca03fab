"""
Effort that is the node's own output.

An arm that floats on the published torque and is led by hand measures what was sent, whatever it
carries. A model confirms itself on such samples. So the torque that was published around every
sample is kept, and a new model is taken only if it explains the effort better than that does.
Friction is left out of the comparison: a position controller that supplies it, on top of the
published torque, may hide a light payload in it.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.node.live_friction import rms
import numpy as np

# How long a driver may take from a command to the effort that it reports, s.
DELAYS = (0.0, 0.004, 0.01, 0.02, 0.05, 0.1, 0.2)
# At least half as many torques are kept: enough for the longest delay at 2 kHz.
_MOST = 2000
# This part of the samples must have been taken while torque was published.
_MOSTLY = 0.5
# Published torque below this RMS over all joints, N·m, supports no arm.
_NOTHING = 0.05
# A model must leave less than this part of what the published torque leaves.
_BETTER = 0.9
# rad/s over which friction turns.
_WIDTH = 0.01
# Joints whose published torque hardly varied say nothing, as a part of the one that varied most.
_VARIED = 0.02


class SentTorque:
    """What was published in the last moments."""

    def __init__(self, n_joints: int) -> None:
        self._times: list[float] = []
        self._torques: list[FloatArray] = []
        self._none = np.full(n_joints, np.nan)

    def published(self, now: float, tau: FloatArray) -> None:
        """Note a torque (N,) that leaves the node."""
        times, torques = self._times, self._torques
        if times and now < times[-1]:
            times.clear()
            torques.clear()
        elif len(times) >= _MOST:
            del times[:_MOST // 2], torques[:_MOST // 2]
        times.append(now)
        torques.append(tau)

    def before(self, now: float) -> FloatArray:
        """
        Return the torque that held at each of `DELAYS` before now (D, N); NaN for none.

        What is published at `now` itself answers the sample and is none of them.
        """
        places = [bisect_left(self._times, now - delay) - 1 for delay in DELAYS]
        return np.array([self._torques[k] if k >= 0 else self._none for k in places])


@dataclass(frozen=True, eq=False)
class Sent:
    """The published torque of the samples of a job, (M, D, N) each, NaN where there was none."""

    train: FloatArray
    held: FloatArray


def echo_objection(sent: Sent, train: JointSamples, held: JointSamples, new_train: FloatArray,
                   new_held: FloatArray, has_new_effects: bool = False) -> str | None:
    """
    Return why these samples only repeat what the node sent, None if they do not.

    :param new_train: torque of the new model at the samples (M, N), N·m; `new_held` likewise.
    :param has_new_effects: friction is part of what is new, so it is not left out.
    """
    torque = np.concatenate((sent.train, sent.held))
    tau = np.concatenate((train.tau, held.tau))
    there = np.isfinite(torque).all(axis=(1, 2))
    if there.mean() < _MOSTLY or there.sum() < 5:
        return None
    torque, tau = torque[there], tau[there]
    if float(np.sqrt((torque ** 2).mean())) < _NOTHING:
        return None
    qd = np.concatenate((train.qd, held.qd))[there]
    errors = [tau - np.concatenate((new_train, new_held))[there],
              *(tau - torque[:, k] for k in range(len(DELAYS)))]
    if not has_new_effects:
        errors = [_beside_friction(error, qd) for error in errors]
    error, left = errors[0], np.array([rms(each) for each in errors[1:]])
    spread = torque[:, 0].std(axis=0)
    counts = spread > _VARIED * float(spread.max(initial=0.0))
    best = int(np.argmin(np.sqrt((left[:, counts] ** 2).mean(axis=1))))
    echo = float(np.sqrt((left[best, counts] ** 2).mean()))
    new = float(np.sqrt((error[:, counts] ** 2).mean()))
    if new < _BETTER * echo:
        return None
    return ('the effort is the torque that this node published '
            f'{1e3 * DELAYS[best]:.0f} ms before: RMS difference {echo:.3g} N·m, residual of the '
            f'new model {new:.3g}. Either the model in use is right already, or the arm floats on '
            'that torque and is led by hand, which shows nothing new: move it by its own '
            'controller')


def _beside_friction(residual: FloatArray, qd: FloatArray) -> FloatArray:
    """Return a residual (M, N) without the Coulomb and viscous friction that explain most."""
    found = np.empty_like(residual)
    for n in range(residual.shape[1]):
        columns = np.column_stack([np.tanh(qd[:, n] / _WIDTH), qd[:, n]])
        coefficients = lstsq(columns, residual[:, n])
        found[:, n] = residual[:, n] - columns @ coefficients
    return found
