"""What became of a fleet: what each robot has now, and what failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from gravity_comp_ros.diagnosis.findings import Estimate, Finding


@dataclass(frozen=True)
class FittedRobot:
    """The file of a robot's `model`, how many bags and samples it is of, and its RMSE in N·m."""

    model: str
    bags: int
    samples: int
    converged: bool
    rmse: Mapping[str, float]
    warnings: tuple[str, ...]

    @classmethod
    def from_json(cls, kept: dict[str, Any]) -> FittedRobot:
        """Return what an earlier run kept."""
        return cls(**{**kept, 'warnings': tuple(kept['warnings'])})

    def to_json(self) -> dict[str, Any]:
        """Return the robot as `fleet --json` prints it."""
        return asdict(self)


@dataclass(frozen=True)
class DiagnosedRobot:
    """The file of a robot's `diagnosis`, and its findings."""

    diagnosis: str
    findings: tuple[Finding, ...]

    @classmethod
    def from_json(cls, file: str, kept: dict[str, Any]) -> DiagnosedRobot:
        """Return the robot with a diagnosis as `diagnose --json` prints it."""
        return cls(file, tuple(Finding(**{
            **entry, 'rivals': tuple(entry['rivals']),
            'coefficients': {symbol: Estimate(**{**x, 'ci95': tuple(x['ci95'])})
                             for symbol, x in entry['coefficients'].items()}})
            for entry in kept['findings']))

    def to_json(self) -> dict[str, Any]:
        """Return the robot as `fleet --json` prints it."""
        return {'diagnosis': self.diagnosis, 'findings': [f.to_json() for f in self.findings]}


@dataclass
class Outcome:
    """
    What became of a fleet: per robot what it has now, and why bags and robots failed.

    `resumed` counts the bags and robots that an earlier run had done.
    """

    robots: dict[str, FittedRobot | DiagnosedRobot] = field(default_factory=dict)
    failed_bags: dict[str, str] = field(default_factory=dict)
    failed_robots: dict[str, str] = field(default_factory=dict)
    resumed: int = 0

    def to_json(self) -> dict[str, Any]:
        """Return what `fleet --json` prints."""
        return {**vars(self), 'robots': {name: robot.to_json()
                                         for name, robot in self.robots.items()}}
