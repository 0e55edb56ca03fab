"""Excitation of a recording, and the effects that are not identifiable from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.commands import terminal
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis, JointReport
from gravity_comp_ros.effects.motion_direction import min_speeds, speed_noise
from gravity_comp_ros.facts.motion import describe, RecordingFacts
import numpy as np
from rich.table import Table

_COLUMNS = ('joint', 'range rad', 'max rad/s', 'reversals', 'at rest', 'white noise N·m',
            'effective n')


@dataclass(frozen=True)
class DataCheck:
    """
    Excitation, noise and untestable effects of each joint of a recording.

    `rest` is the share of samples at rest. `reports` has the noise floor, the effective sample
    size and the untestable effects of each joint, with the reason. `arm_untestable` has those of
    the whole arm.
    """

    facts: RecordingFacts
    rest: Mapping[str, float]
    reports: Mapping[str, JointReport]
    arm_untestable: Mapping[str, str]

    def table(self) -> Table:
        """Return the table of joints."""
        rows = []
        for name, report in self.reports.items():
            joint = self.facts.joints[name]
            rows.append((name, f'{joint.q_min:.2f} … {joint.q_max:.2f}', f'{joint.max_speed:.3f}',
                         '–' if joint.reversals is None else str(joint.reversals),
                         f'{100 * self.rest[name]:.0f} %', f'{report.noise_floor:.3g}',
                         f'{report.n_effective:.0f}'))
        return terminal.table(
            f'recording: {self.facts.n_samples} samples; they are autocorrelated, so the '
            'effective sample size is smaller', _COLUMNS, rows)

    def untestable(self) -> list[str]:
        """Return a line for each effect that is untestable on some joints, with the reason."""
        grouped: dict[str, list[tuple[str, str]]] = {}
        for name, report in self.reports.items():
            for effect, reason in report.untestable.items():
                grouped.setdefault(effect, []).append((name, reason))
        lines = [f'{effect}: {reason}' for effect, reason in self.arm_untestable.items()]
        for effect, entries in grouped.items():
            names = [name for name, _ in entries]
            joints = 'every joint' if len(names) == len(self.reports) else ', '.join(names)
            lines.append(f'{effect} on {joints}: {entries[0][1]}')
        return lines

    def to_json(self) -> dict[str, Any]:
        """Return the facts that are not part of the diagnosis."""
        return {
            'joints': {name: {'q_min': joint.q_min, 'q_max': joint.q_max,
                              'max_speed': joint.max_speed, 'rms_speed': joint.rms_speed,
                              'reversals': joint.reversals, 'rest': self.rest[name]}
                       for name, joint in self.facts.joints.items()},
            'n_samples': self.facts.n_samples, 'remarks': list(self.facts.remarks)}


def check_data(samples: JointSamples, diagnosis: Diagnosis) -> DataCheck:
    """Return the data check of diagnosed samples."""
    samples = samples.joints(tuple(diagnosis.joints))
    still = np.abs(samples.qd) < 0.5 * min_speeds(speed_noise(samples))
    return DataCheck(describe(samples), dict(zip(samples.names, still.mean(axis=0).tolist())),
                     diagnosis.joints, diagnosis.untestable)
