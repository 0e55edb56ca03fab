"""Error metrics of a diagnosis: RMSE, fractions of the torque range, improved runs."""

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
class ErrorMetrics:
    """
    Conversion of block errors to reported numbers.

    :param span: (N,) range of the measured torque in N·m, to which errors are relative.
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
        """Return the RMSE of block errors as a fraction of the torque range (Yu 2022, Eq. 16)."""
        return self.rmse(errors, joint) / max(float(self.span[joint]), 1e-9)

    def nrmse(self, chosen: Sequence[Candidate], joint: int) -> float:
        """Return the held-out RMSE with these effects as a fraction of the torque range."""
        return self.nrmse_of(self.criteria.fits.errors(joint, chosen), joint)

    def runs_better(self, gain: Gain) -> float:
        """Return the share of runs that an effect improves."""
        run = self.criteria.fits.blocks.run
        return float(np.mean([gain.blocks[run == r].sum() > 0.0 for r in np.unique(run)]))

    def unabsorbed(self, candidate: Candidate) -> float:
        """Return the share of an effect's torque that gravity does not absorb; 1 if shared."""
        absorbed = self.criteria.fits.absorbed(candidate)
        return 1.0 if candidate.shared else float(np.sqrt(1.0 - absorbed))
