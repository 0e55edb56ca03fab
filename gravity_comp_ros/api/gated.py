"""The samples that gravity is learned from, and why the others were dropped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.data.gate import GateOptions, slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import DataError, Hint
from gravity_comp_ros.printable import counted


@dataclass(frozen=True, eq=False)
class Gated:
    """Of `total` samples those that passed the gate, and how many were dropped by reason."""

    samples: JointSamples
    total: int
    dropped: Mapping[str, int]
    all_samples: bool

    def to_json(self) -> dict[str, Any]:
        """Return what a model's provenance and `--json` hold of the gate."""
        return {'total': self.total, 'kept': self.samples.n_samples,
                'dropped': dict(self.dropped), 'all_samples': self.all_samples}

    def sentence(self) -> str:
        """Return one line on what was kept and why the rest was not."""
        if self.all_samples:
            return f'{counted(self.total, "sample")} used, fast ones too'
        why = ', '.join(f'{count} {reason}' for reason, count in self.dropped.items() if count)
        return (f'{self.samples.n_samples} of {counted(self.total, "sample")} pass the '
                'slow-motion gate'
                + (f' ({why})' if why else ''))


def apply_gate(samples: JointSamples, options: GateOptions | None) -> Gated:
    """
    Return the samples that the gate lets through; without a gate that is all of them.

    :raises DataError: if none passes.
    """
    if options is None:
        return Gated(samples, samples.n_samples, {}, True)
    result = slow_samples(samples, options)
    return passed(result.samples, samples.n_samples, result.dropped, options)


def passed(samples: JointSamples, total: int, dropped: Mapping[str, int],
           options: GateOptions) -> Gated:
    """
    Return the samples that passed the gate while they were read.

    :raises DataError: if none did.
    """
    if samples.n_samples == 0:
        limit = options.max_speed
        shown = f'{limit:g}' if isinstance(limit, float) else ', '.join(f'{x:g}' for x in limit)
        raise DataError(f'none of the {total} samples is slow (every joint under {shown} rad/s)',
                        Hint.SLOW_MOTION)
    return Gated(samples, total, dict(dropped), False)
