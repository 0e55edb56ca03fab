"""Result of the slow-motion gate: samples for the gravity fit and counts of dropped samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.data.acceleration import with_accelerations
from gravity_comp_ros.data.gate import GateOptions, slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import DataError, Hint
from gravity_comp_ros.printable import counted


@dataclass(frozen=True, eq=False)
class Gated:
    """Samples that passed the gate, out of `total`, and the number dropped by reason."""

    samples: JointSamples
    total: int
    dropped: Mapping[str, int]
    all_samples: bool

    def to_json(self) -> dict[str, Any]:
        """Return the gate entry of a model's provenance and of `--json`."""
        return {'total': self.total, 'kept': self.samples.n_samples,
                'dropped': dict(self.dropped), 'all_samples': self.all_samples}

    def sentence(self) -> str:
        """Return one line with the number of samples kept, and of those dropped by reason."""
        if self.all_samples:
            return f'{counted(self.total, "sample")} used, including fast ones'
        reasons = ', '.join(f'{count} {reason}' for reason, count in self.dropped.items() if count)
        return (f'{self.samples.n_samples} of {counted(self.total, "sample")} pass the '
                f'slow-motion gate{f" ({reasons})" if reasons else ""}')


def apply_gate(samples: JointSamples, options: GateOptions | None) -> Gated:
    """
    Return the samples that pass the gate; all of them if `options` is None.

    :raises DataError: if none passes.
    """
    if options is None:
        return Gated(with_accelerations(samples, samples), samples.n_samples, {}, True)
    result = slow_samples(samples, options)
    if result.samples.n_samples == 0:
        limit = options.max_speed
        limits = f'{limit:g}' if isinstance(limit, float) else ', '.join(f'{x:g}' for x in limit)
        raise DataError(f'none of the {samples.n_samples} samples is slow (every joint under '
                        f'{limits} rad/s)', Hint.SLOW_MOTION)
    return Gated(result.samples, samples.n_samples, dict(result.dropped), False)
