"""
The one look at a recording: facts about its signals, and the corrected signals.

Each step sees the signals that the steps before it corrected. A fact that the reader accepts
(`--accept`) is still listed, and the recording is read as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.facts import efforts, joints, outliers
from gravity_comp_ros.facts.fact import Action, Fact, Kind, unless_accepted
from gravity_comp_ros.facts.friction import effort_facts
from gravity_comp_ros.facts.lag import filtered_effort, velocity_facts
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals
import numpy as np

_Rows = Callable[[Signals], tuple[BoolArray, Fact | None]]
# Steps that leave out samples, in this order: a disabled drive has no limit, and a limit that is
# exceeded by a spike is not found.
_ROWS: tuple[_Rows, ...] = (outliers.glitches, efforts.disabled, outliers.spikes,
                            efforts.saturated, efforts.frozen)


@dataclass(frozen=True, eq=False)
class Judgement:
    """Corrected signals, facts, samples left out by kind, and differentiated joints."""

    signals: Signals
    facts: tuple[Fact, ...]
    left_out: dict[str, int]
    differentiated: BoolArray


def judge(signals: Signals, scale: FloatArray, missing: BoolArray, chosen: bool = False,
          accept: Collection[str] = ()) -> Judgement:
    """
    Return the facts about a recording of one run, and its corrected signals.

    Refusals are facts of action `REFUSED`; the caller raises the error.

    :param signals: recorded arrays; positions in rad, efforts in the recorded unit, finite.
    :param scale: N·m per recorded unit of effort, sign included, (N,).
    :param missing: mask (N,) of joints without recorded velocities.
    :param chosen: whether the joints were named by the reader, who then keeps all of them.
    :param accept: kinds of facts to accept: they are listed, and nothing is done about them.
    """
    facts: list[Fact] = []
    left_out: dict[str, int] = {}

    def add(fact: Fact) -> bool:
        """Add a fact; return whether its action is to be taken."""
        facts.append(unless_accepted(fact, accept))
        return fact.kind not in accept

    def add_all(more: Iterable[Fact]) -> None:
        for fact in more:
            add(fact)

    for fact in joints.by_position(signals) if len(signals) >= FACTS.min_samples else ():
        if fact.action is Action.LEFT_OUT and chosen:
            fact = replace(fact, action=Action.NOTED, done='kept, as it is named', otherwise='')
        if add(fact) and fact.action is Action.LEFT_OUT:
            gone = np.isin(signals.names, fact.joints)
            signals, scale, missing = signals.without(gone), scale[~gone], missing[~gone]
    raw = signals.tau
    signals = replace(signals, tau=raw * scale)
    add_all(efforts.dead(signals))
    add_all(efforts.unit(signals, raw, np.abs(scale) != 1.0))
    q, wraps = outliers.unwrapped(signals)
    if wraps is not None and add(wraps):
        signals = replace(signals, q=q)
    for step in _ROWS:
        if len(signals) < FACTS.min_samples:
            break
        bad, of_rows = step(signals)
        if of_rows is not None and bad.all():
            of_rows = replace(of_rows, action=Action.REFUSED, done='no sample is left')
        if of_rows is not None and add(of_rows) and not bad.all():
            left_out[of_rows.kind] = int(bad.sum())
            signals = signals.keep(~bad)
    replaced, of_velocity = velocity_facts(signals, missing)
    add_all(of_velocity)
    if Kind.VELOCITY in accept:
        replaced = missing
    if replaced.any():
        qd = signals.qd.copy()
        qd[:, replaced] = differentiate(signals.t, signals.q[:, replaced])
        signals = replace(signals, qd=qd)
    unfiltered, lag = filtered_effort(signals)
    if lag is not None and add(lag):
        signals = unfiltered
    finite = signals.keep(np.asarray(np.isfinite(signals.qd).all(axis=1)))
    add_all(joints.small_degrees(finite))
    add_all(effort_facts(finite))
    return Judgement(signals, tuple(facts), left_out, replaced)
