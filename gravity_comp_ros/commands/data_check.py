"""What a recording can tell and what it cannot, before anything is concluded from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.screen_table import ScreenTable
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis.findings import Diagnosis, JointReport
from gravity_comp_ros.effects.motion_direction import least_widths
from gravity_comp_ros.evaluation.recording_quality import describe, RecordingFacts
import numpy as np

_COLUMNS = ('joint', 'range rad', 'max rad/s', 'reversals', 'at rest', 'white noise N·m',
            'effective n')


@dataclass(frozen=True)
class DataCheck:
    """
    Facts on the recording, joint by joint.

    `rest` is the share of time that a joint stands; the reports hold the noise floor, how many
    samples are independent, and which effects this recording does not show; `arm_untestable`
    the same of effects of the whole arm.
    """

    facts: RecordingFacts
    rest: Mapping[str, float]
    reports: Mapping[str, JointReport]
    arm_untestable: Mapping[str, str]

    def table(self) -> ScreenTable:
        """Return the facts as a table."""
        rows = []
        for name, report in self.reports.items():
            joint = self.facts.joints[name]
            rows.append((name, f'{joint.q_min:.2f} … {joint.q_max:.2f}', f'{joint.max_speed:.3f}',
                         '–' if joint.reversals is None else str(joint.reversals),
                         f'{100 * self.rest[name]:.0f} %', f'{report.noise_floor:.3g}',
                         f'{report.n_effective:.0f}'))
        return terminal.table(
            f'the recording: {self.facts.n_samples} samples; they are autocorrelated, so '
            'the effective number is smaller', _COLUMNS, rows)

    def unseen(self) -> list[str]:
        """Return a line for each effect that some joints do not show, with the reason."""
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
        """Return what is not in the diagnosis already."""
        return {
            'joints': {name: {'q_min': joint.q_min, 'q_max': joint.q_max,
                              'max_speed': joint.max_speed, 'rms_speed': joint.rms_speed,
                              'reversals': joint.reversals, 'rest': self.rest[name]}
                       for name, joint in self.facts.joints.items()},
            'n_samples': self.facts.n_samples, 'remarks': list(self.facts.remarks)}


def check(samples: JointSamples, diagnosis: Diagnosis) -> DataCheck:
    """Return the facts on the samples that a diagnosis was made from."""
    samples = samples.joints(tuple(diagnosis.joints))
    still = np.abs(samples.qd) < 0.5 * least_widths(samples)
    return DataCheck(describe(samples), dict(zip(samples.names, still.mean(axis=0).tolist())),
                     diagnosis.joints, diagnosis.untestable)
