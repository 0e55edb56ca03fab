"""From block errors to the numbers that are shown: RMSE, fractions of the torque, runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import Criteria
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.evaluation.gain import Gain
import numpy as np


@dataclass(frozen=True, eq=False)
class Scale:
    """
    The units of a diagnosis.

    :param span: (N,) the range of the measured torque in N·m, of which errors are a fraction.
    """

    criteria: Criteria
    motion: Motion
    span: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        return self.motion.samples.names

    def rmse(self, errors: FloatArray, joint: int) -> float:
        """Return the RMSE in N·m of block errors."""
        total = max(float(errors.sum()), 0.0)
        return float(np.sqrt(total / self.motion.samples.n_samples)
                     * self.criteria.fits.rows[joint].sigma)

    def nrmse_of(self, errors: FloatArray, joint: int) -> float:
        """Return the RMSE of block errors as a fraction of the torque's range (Eq. 16)."""
        return self.rmse(errors, joint) / max(float(self.span[joint]), 1e-9)

    def nrmse(self, chosen: Sequence[Candidate], joint: int) -> float:
        """Return the held-out RMSE with these effects as a fraction of the torque's range."""
        return self.nrmse_of(self.criteria.fits.errors(joint, chosen), joint)

    def runs_better(self, gain: Gain) -> float:
        """Return the share of runs on which an effect helps."""
        run = self.criteria.fits.blocks.run
        return float(np.mean([gain.blocks[run == r].sum() > 0.0 for r in np.unique(run)]))

    def absorbed(self, candidate: Candidate) -> float:
        """Return the share of an effect that gravity can imitate, given the other joints."""
        return self.criteria.fits.absorbed(candidate)

    def left(self, candidate: Candidate) -> float:
        """Return the share of an effect's torque that gravity does not imitate, 1 of the arm's."""
        return 1.0 if candidate.shared else float(np.sqrt(1.0 - self.absorbed(candidate)))
