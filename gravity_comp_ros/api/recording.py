"""`Recording`: joint samples of one or several runs, with gate, hold-out and read reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TYPE_CHECKING

from gravity_comp_ros.api.arrays import ArrayOrRuns, samples_from_arrays
from gravity_comp_ros.api.provenance import Holdout
from gravity_comp_ros.data.gate import apply_gate, GateOptions, GateResult
from gravity_comp_ros.data.holdout import HoldoutOptions, split, within
from gravity_comp_ros.data.runs import rows_of
from gravity_comp_ros.data.samples import BoolArray, JointSamples
from gravity_comp_ros.display import Displayable, TextTable
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.printable import counted
import numpy as np
if TYPE_CHECKING:
    # Imports file-format libraries, which arrays do not need.
    from gravity_comp_ros.recordings.bag import ReadReport

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Displayable):
    """
    Motion of an arm in one or several runs, as input of every step of the loop.

        data = gc.Recording.from_arrays(q, tau, t, names=['shoulder', 'elbow'])
        train, test = data.split(0.2)

    - `samples`: M samples of N joints, including fast motion: `t` (M,) in s, `q` (M, N) in rad,
      `qd` in rad/s, `tau` in N·m.
    - `gate`: limits for slow samples, None for no gate. `slow` are the samples that pass it;
      gravity is fitted to them and compared with them.
    - `reports`: read report of each run; empty for arrays.
    - `use`: boolean mask (M,) of the part selected by `split`; None for all.
    - `holdout`: the blocks held out by `split`; None without a split.
    - `ungated`: reason why the gate was removed, '' if it was not.

    Recordings compare by identity, not by value.
    """

    samples: JointSamples
    gate: GateOptions | None = GateOptions()
    reports: tuple[ReadReport, ...] = ()
    use: BoolArray | None = None
    holdout: Holdout | None = None
    ungated: str = ''

    @classmethod
    def from_arrays(cls, q: ArrayOrRuns, tau: ArrayOrRuns, t: ArrayOrRuns | None = None, *,
                    qd: ArrayOrRuns | None = None, rate: float | None = None,
                    names: Sequence[str] | None = None, degrees: bool = False,
                    effort_scale: float | Mapping[str, float] = 1.0,
                    gate: GateOptions | None = GateOptions()) -> Recording:
        """
        Create a recording from NumPy arrays of one run, or from lists with one array per run.

            data = gc.Recording.from_arrays([q1, q2], [tau1, tau2], [t1, t2])

        :param q: joint positions (M, N) in rad.
        :param tau: joint torques (M, N) in N·m; positive torque accelerates q in its positive
            direction.
        :param t: times (M,) in s, increasing within a run. Give either `t` or `rate`.
        :param qd: joint velocities (M, N) in rad/s; by default differentiated from q.
        :param rate: sample rate in Hz.
        :param names: names of the N joints; by default `joint_1`, `joint_2`, ...
        :param degrees: True if q and qd are in degrees and degrees per second.
        :param effort_scale: torque per unit of `tau`, N·m, sign included, for all joints or by
            name. Use it for motor currents and inverted signs.
        :param gate: limits for slow samples; None uses all samples.
        :raises DataError: if shapes disagree, a value is not finite, or time does not increase.
        :raises ModelMismatchError: if `effort_scale` names an unknown joint.
        :raises OptionError: if not exactly one of `t` and `rate` is given, or a scale is invalid.
        """
        return cls(samples_from_arrays(q, tau, t, qd, rate, names, degrees, effort_scale), gate)

    def __len__(self) -> int:
        return int(self.usable.sum())

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the N joints."""
        return self.samples.names

    @property
    def n_runs(self) -> int:
        """Return the number of runs."""
        return self.samples.n_runs

    @cached_property
    def usable(self) -> BoolArray:
        """Return the mask (M,) of the samples selected by `split`; all True without a split."""
        return np.ones(len(self.samples), dtype=bool) if self.use is None else self.use

    @cached_property
    def gated(self) -> GateResult:
        """
        Return the gate result for all samples.

        :raises DataError: if no sample is slow.
        """
        return apply_gate(self.samples, self.gate)

    @cached_property
    def slow(self) -> JointSamples:
        """
        Return the usable samples that pass the gate, with accelerations if the rate resolves them.

        :raises DataError: if no sample is slow.
        """
        slow = self.gated.samples
        if self.use is None:
            return slow
        return slow.select(self.use[rows_of(self.samples, slow)])

    @property
    def used(self) -> JointSamples:
        """Return the usable samples, including fast motion."""
        return self.samples if self.use is None else self.samples.select(self.use)

    def select_joints(self, names: Sequence[str]) -> Recording:
        """
        Return the recording with these joints, in this order.

        :raises ModelMismatchError: if there is no such joint.
        """
        if tuple(names) == self.joints:
            return self
        return replace(self, samples=self.samples.joints(names))

    def split(self, fraction: float = 0.2, guard: float = 1.0) -> tuple[Recording, Recording]:
        """
        Return a training part and a held-out part.

            train, test = data.split(0.2)

        Of several runs, the last ones are held out, at least one. Of a single run, two blocks of
        time are held out. Neither part includes samples within `guard` of a block, because
        neighbouring samples are autocorrelated.

        :param fraction: held-out fraction of the runs or samples, between 0 and 1.
        :param guard: excluded time before and after each block, s.
        :raises DataError: if one of the parts would be empty.
        :raises OptionError: if the fraction is not between 0 and 1.
        """
        parts = split(self.slow, HoldoutOptions(fraction, guard))
        holdout = Holdout(fraction, parts.held_out.n_samples, parts.blocks)
        train = self.usable & ~within(self.samples, parts.guarded)
        test = self.usable & within(self.samples, parts.blocks)
        return replace(self, use=train, holdout=holdout), replace(self, use=test, holdout=holdout)

    def to_json(self) -> dict[str, Any]:
        """Return the entries `bags` and `gate` of a model's provenance."""
        return {'bags': [report.to_json() for report in self.reports],
                'gate': self.gated.to_json()}

    def summary(self) -> str:
        """Return one line: number of joints, runs and samples, duration."""
        seconds = sum(float(np.ptp(run.t)) for run in self.samples.each_run() if len(run))
        part = '' if self.use is None else f', {len(self)} of them in use'
        return (f'{counted(len(self.joints), "joint")}, {counted(self.n_runs, "run")}, '
                f'{len(self.samples)} samples over {seconds:.1f} s{part}')

    def details(self) -> Iterable[str | TextTable]:
        """Return the gate result, and a table with the range and speed of each joint."""
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
