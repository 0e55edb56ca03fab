"""Options of each component of the node, from its parameters."""

from __future__ import annotations

from dataclasses import fields

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.node.epoch import EpochOptions
from gravity_comp_ros.node.feedforward import FeedForwardOptions
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.payload import PayloadLimits


def gate_options(given: Parameters) -> GateOptions:
    """Return the options of the slow-motion gate."""
    return GateOptions(given.max_speed, given.max_acceleration or None, given.sample_rate)


def epoch_options(given: Parameters) -> EpochOptions:
    """Return the sizes of an epoch."""
    return EpochOptions(given.capacity, given.min_samples, given.first_samples,
                        given.full_samples, given.min_span,
                        block=max(5, round(given.sample_rate)))


def feedforward_options(given: Parameters) -> FeedForwardOptions:
    """Return the options of the feed-forward; their names are those of the parameters."""
    return FeedForwardOptions(**{each.name: getattr(given, each.name)
                                 for each in fields(FeedForwardOptions)
                                 if hasattr(given, each.name)})


def payload_limits(given: Parameters) -> PayloadLimits:
    """Return the limits of a payload."""
    return PayloadLimits(given.max_payload, given.max_payload_reach)
