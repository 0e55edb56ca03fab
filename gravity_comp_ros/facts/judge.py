"""
The one look at a recording: facts about its signals, and the corrected signals.

Each step sees the signals that the steps before it corrected. A fact that the reader accepts
(`--accept`) is still listed, and the recording is read as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.facts import efforts, joints, outliers
from gravity_comp_ros.facts.fact import Action, as_noted, Fact, Kind
from gravity_comp_ros.facts.friction import effort_facts
from gravity_comp_ros.facts.lag import filtered_effort
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.facts.velocity import velocity_facts
import numpy as np

_Rows = Callable[[Signals, FactOptions], tuple[BoolArray, Fact | None]]
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


class _Judge:
    def __init__(self, accept: frozenset[Kind], options: FactOptions) -> None:
        self.accept, self.options = accept, options
        self.facts: list[Fact] = []
        self.left_out: dict[str, int] = {}

    def add(self, fact: Fact) -> bool:
        """Add a fact; return whether its action is to be taken."""
        accepted = fact.kind in self.accept
        self.facts.append(as_noted(fact) if accepted else fact)
        return not accepted

    def joints(self, signals: Signals, chosen: bool) -> Signals:
        for fact in joints.by_position(signals, self.options):
            if fact.action is Action.LEFT_OUT and chosen:
                fact = replace(fact, action=Action.NOTED, done='kept, as it is named',
                               otherwise='')
            if self.add(fact) and fact.action is Action.LEFT_OUT:
                signals = signals.without(np.isin(signals.names, fact.joints))
        return signals

    def rows(self, signals: Signals) -> Signals:
        if len(signals) < self.options.min_samples:
            return signals
        for step in _ROWS:
            bad, fact = step(signals, self.options)
            if fact is not None and self.add(fact):
                self.left_out[fact.kind.value] = int(bad.sum())
                signals = signals.keep(~bad)
        return signals

    def velocity(self, signals: Signals, missing: BoolArray) -> tuple[Signals, BoolArray]:
        replaced, facts = velocity_facts(signals, missing, self.options)
        for fact in facts:
            self.add(fact)
        if Kind.VELOCITY in self.accept:
            replaced = missing
        if replaced.any():
            qd = signals.qd.copy()
            qd[:, replaced] = differentiate(signals.t, signals.q[:, replaced])
            signals = replace(signals, qd=qd)
        return signals, replaced


def judge(signals: Signals, scale: FloatArray, missing: BoolArray, chosen: bool = False,
          accept: frozenset[Kind] = frozenset(),
          options: FactOptions = FactOptions()) -> Judgement:
    """
    Return the facts about a recording of one run, and its corrected signals.

    Refusals are facts of action `REFUSED`; the caller raises the error.

    :param signals: recorded arrays; positions in rad, efforts in the recorded unit, finite.
    :param scale: N·m per recorded unit of effort, sign included, (N,).
    :param missing: mask (N,) of joints without recorded velocities.
    :param chosen: whether the joints were named by the reader, who then keeps all of them.
    :param accept: kinds of facts to accept: they are listed, and nothing is done about them.
    """
    judge = _Judge(accept, options)
    everything = signals.names
    signals = judge.joints(signals, chosen)
    here = np.isin(everything, signals.names)
    raw, missing = signals.tau, missing[here]
    signals = replace(signals, tau=raw * scale[here])
    for fact in (*efforts.dead(signals, options), *efforts.unit(signals, raw, options)):
        judge.add(fact)
    q, wraps = outliers.unwrapped(signals)
    if wraps is not None and judge.add(wraps):
        signals = replace(signals, q=q)
    signals = judge.rows(signals)
    signals, replaced = judge.velocity(signals, missing)
    unfiltered, lag = filtered_effort(signals, options)
    if lag is not None and judge.add(lag):
        signals = unfiltered
    finite = signals.keep(np.asarray(np.isfinite(signals.qd).all(axis=1)))
    for fact in (*joints.small_degrees(finite, options), *effort_facts(finite, options)):
        judge.add(fact)
    return Judgement(signals, tuple(judge.facts), judge.left_out, replaced)
