"""`Recording`: joint samples, the slow ones among them, and where they are from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TYPE_CHECKING

from gravity_comp_ros.api.arrays import ArrayOrRuns, samples_from_arrays
from gravity_comp_ros.api.gated import apply_gate, Gated
from gravity_comp_ros.api.provenance import Holdout
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.holdout import HoldoutOptions, split, within
from gravity_comp_ros.data.samples import BoolArray, JointSamples
from gravity_comp_ros.display import Displayable, TextTable
from gravity_comp_ros.effects.predict import rows_of
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.printable import counted
import numpy as np
if TYPE_CHECKING:
    # Needs the libraries of file formats, which arrays do without.
    from gravity_comp_ros.recordings.bag import ReadReport

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Displayable):
    """
    One or several runs of an arm's motion, ready for every step of the loop.

    `samples` are as recorded, fast motion included. `slow` are those that gravity is learned
    from and judged on: they pass the `gate` (None: all do). `reports` say how each run was
    read, and are empty for arrays. `use` (M,) is the part of the samples that the recording
    stands for after `split`, None for all. `ungated` says why there is no gate where too little
    was slow. Recordings do not compare by `==`.
    """

    samples: JointSamples
    gate: GateOptions | None = GateOptions()
    reports: tuple[ReadReport, ...] = ()
    use: BoolArray | None = None
    holdout: Holdout | None = None
    gated_before: Gated | None = None
    ungated: str = ''

    @classmethod
    def from_arrays(cls, q: ArrayOrRuns, tau: ArrayOrRuns, t: ArrayOrRuns | None = None, *,
                    qd: ArrayOrRuns | None = None, rate: float | None = None,
                    names: Sequence[str] | None = None, degrees: bool = False,
                    effort_scale: float | Mapping[str, float] = 1.0,
                    gate: GateOptions | None = GateOptions()) -> Recording:
        """
        Return a recording of NumPy arrays, one run each, or of lists of such arrays.

        :param q: positions (M, N) in rad; a list of arrays is a list of runs.
        :param tau: torque of the drives (M, N) in N·m, positive where it accelerates q upwards.
        :param t: times (M,) in s, increasing within a run; or give `rate`.
        :param qd: velocities (M, N) in rad/s; without them they are differentiated from q.
        :param rate: samples per second, instead of `t`.
        :param names: the N joints; `joint_1`, `joint_2`, ... without.
        :param degrees: q and qd are in degrees and degrees per second.
        :param effort_scale: N·m per unit of `tau`, sign included, for all joints or by name
            (motor currents, drives that count the other way).
        :param gate: which samples count as slow; None takes all.
        :raises DataError: if shapes disagree, a value is not finite, or time does not increase.
        :raises OptionError: if neither `t` nor `rate` is given, or a scale makes no sense.
        """
        return cls(samples_from_arrays(q, tau, t, qd, rate, names, degrees, effort_scale), gate)

    def __len__(self) -> int:
        return int(self.usable.sum())

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the joints."""
        return self.samples.names

    @property
    def n_runs(self) -> int:
        """Return the number of runs."""
        return self.samples.n_runs

    @cached_property
    def usable(self) -> BoolArray:
        """Return which samples (M,) the recording stands for."""
        return np.ones(len(self.samples), dtype=bool) if self.use is None else self.use

    @cached_property
    def gated(self) -> Gated:
        """
        Return what the gate keeps of all samples.

        :raises DataError: if none is slow.
        """
        return self.gated_before or apply_gate(self.samples, self.gate)

    @cached_property
    def slow(self) -> JointSamples:
        """
        Return the usable samples that pass the gate.

        :raises DataError: if none is slow.
        """
        slow = self.gated.samples
        if self.use is None:
            return slow
        return slow.select(self.use[rows_of(self.samples, slow)])

    @property
    def used(self) -> JointSamples:
        """Return the usable samples, fast motion included."""
        return self.samples if self.use is None else self.samples.select(self.use)

    def select_joints(self, names: Sequence[str]) -> Recording:
        """
        Return the same motion with these joints, in this order.

        :raises ModelMismatchError: if there is no such joint.
        """
        if tuple(names) == self.joints:
            return self
        before = self.gated_before
        return replace(self, samples=self.samples.joints(names), gated_before=before and replace(
            before, samples=before.samples.joints(names)))

    def split(self, fraction: float = 0.2, guard: float = 1.0) -> tuple[Recording, Recording]:
        """
        Return a part to fit and a part to judge on.

        Of several runs the last ones are held out, `fraction` of all but at least one; of a
        single run two blocks of time are. `guard` s around a block are in neither part,
        because neighbouring samples are alike.

        :raises DataError: if one of the parts would be empty.
        :raises OptionError: if the fraction is not between 0 and 1.
        """
        parts = split(self.slow, HoldoutOptions(fraction, guard))
        kept = Holdout(fraction, parts.held_out.n_samples, parts.blocks)
        fitted = self.usable & ~within(self.samples, parts.guarded)
        judged = self.usable & within(self.samples, parts.blocks)
        return (replace(self, use=fitted, holdout=kept), replace(self, use=judged, holdout=kept))

    def to_json(self) -> dict[str, Any]:
        """Return what was read and gated, as a model's provenance holds it."""
        return {'bags': [report.to_json() for report in self.reports],
                'gate': self.gated.to_json()}

    def summary(self) -> str:
        """Return one line: joints, runs, samples, time."""
        seconds = sum(float(np.ptp(run.t)) for run in self.samples.each_run() if len(run))
        part = '' if self.use is None else f', {len(self)} of them in use'
        return (f'{counted(len(self.joints), "joint")}, {counted(self.n_runs, "run")}, '
                f'{len(self.samples)} samples over {seconds:.1f} s{part}')

    def parts(self) -> Iterable[str | TextTable]:
        """Return what the gate keeps, and the range and speed of each joint."""
        try:
            yield self.gated.sentence()
        except DataError as problem:
            yield str(problem)
        used = self.used
        yield TextTable(
            ('joint', 'from rad', 'to rad', 'fastest rad/s', 'torque from N·m', 'to N·m'),
            tuple((name, *(f'{x:.3f}' for x in (
                used.q[:, n].min(), used.q[:, n].max(), np.abs(used.qd[:, n]).max(),
                used.tau[:, n].min(), used.tau[:, n].max()))) for n, name in
                enumerate(self.joints)) if len(used) else ())
