"""Results of a fleet run: models or diagnoses by robot, and failures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from gravity_comp_ros.diagnosis.findings import Estimate, Finding


@dataclass(frozen=True)
class FittedRobot:
    """Model file of a robot, number of bags and samples fitted, RMSE by joint in N·m."""

    model: str
    bags: int
    samples: int
    converged: bool
    rmse: Mapping[str, float]
    warnings: tuple[str, ...]

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> FittedRobot:
        """Return the result stored by an earlier run."""
        return cls(**{**record, 'warnings': tuple(record['warnings'])})

    def to_json(self) -> dict[str, Any]:
        """Return the robot's entry in `fleet --json`."""
        return asdict(self)


@dataclass(frozen=True)
class DiagnosedRobot:
    """Diagnosis file of a robot, and its findings."""

    diagnosis: str
    findings: tuple[Finding, ...]

    @classmethod
    def from_json(cls, file: str, diagnosis: dict[str, Any]) -> DiagnosedRobot:
        """Return the result for a diagnosis in the format of `diagnose --json`."""
        return cls(file, tuple(Finding(**{
            **entry, 'rivals': tuple(entry['rivals']),
            'coefficients': {symbol: Estimate(**{**x, 'ci95': tuple(x['ci95'])})
                             for symbol, x in entry['coefficients'].items()}})
            for entry in diagnosis['findings']))

    def to_json(self) -> dict[str, Any]:
        """Return the robot's entry in `fleet --json`."""
        return {'diagnosis': self.diagnosis, 'findings': [f.to_json() for f in self.findings]}


@dataclass
class Outcome:
    """
    Results of a fleet run by robot, and reasons of failed bags and robots.

    `resumed` is the number of bags and robots completed by an earlier run.
    """

    robots: dict[str, FittedRobot | DiagnosedRobot] = field(default_factory=dict)
    failed_bags: dict[str, str] = field(default_factory=dict)
    failed_robots: dict[str, str] = field(default_factory=dict)
    resumed: int = 0

    def to_json(self) -> dict[str, Any]:
        """Return the output of `fleet --json`."""
        return {**vars(self), 'robots': {name: robot.to_json()
                                         for name, robot in self.robots.items()}}
