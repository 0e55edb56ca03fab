"""Provenance of a model: the recordings it was fitted to and the held-out blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, UTC
from typing import Any, TYPE_CHECKING

from gravity_comp_ros.data.holdout import Block
from gravity_comp_ros.models.gravity_model import GravityModel

if TYPE_CHECKING:
    from gravity_comp_ros.recordings.bag import ReadReport


@dataclass(frozen=True)
class Holdout:
    """Held-out part of a recording: requested fraction, number of samples, blocks of time."""

    fraction: float
    n_samples: int
    blocks: tuple[Block, ...]

    def to_json(self, reports: Sequence[ReadReport]) -> dict[str, Any]:
        """Return the provenance entry; blocks of arrays are omitted, as they have no file."""
        return {'fraction': self.fraction, 'n_samples': self.n_samples,
                'blocks': [{'name': reports[b.run].path.name, 'sha256': reports[b.run].sha256,
                            'start': b.start, 'end': b.end} for b in self.blocks
                           if b.run < len(reports)]}


def merged_bags(model: GravityModel, reports: Iterable[ReadReport]) -> list[dict[str, Any]]:
    """Return the recordings of the model's provenance, and those of `reports` that are new."""
    known = list(model.provenance.get('bags', ()))
    seen = {bag['sha256'] for bag in known}
    return [*known, *(report.to_json() for report in reports if report.sha256 not in seen)]


def held_out_blocks(model: GravityModel, reports: Sequence[ReadReport],
                    guard: float = 0.0) -> list[Block]:
    """Return the blocks of these recordings held out of the fit, each extended by `guard` s."""
    blocks = (model.provenance.get('holdout') or {}).get('blocks', ())
    return [Block(run, block['start'] - guard, block['end'] + guard)
            for run, report in enumerate(reports)
            for block in blocks if block['sha256'] == report.sha256]


def now() -> str:
    """Return the current UTC time in ISO 8601 format."""
    return datetime.now(UTC).isoformat(timespec='seconds')
