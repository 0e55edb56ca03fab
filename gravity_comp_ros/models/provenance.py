"""What a model's provenance says of the recordings that it was fitted to."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.holdout import Block
from gravity_comp_ros.models.gravity_model import GravityModel


def held_out_blocks(model: GravityModel, hashes: Sequence[str],
                    guard: float = 0.0) -> list[Block]:
    """
    Return what `fit --holdout` kept out of the model, and `guard` seconds about it.

    :param hashes: the SHA-256 of each recording, in the order of the runs.
    """
    blocks = (model.provenance.get('holdout') or {}).get('blocks', ())
    return [Block(run, block['start'] - guard, block['end'] + guard)
            for run, sha256 in enumerate(hashes)
            for block in blocks if block['sha256'] == sha256]
