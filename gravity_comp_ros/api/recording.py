"""Motion of an arm as input of every step, from bags or NumPy arrays: several runs, units."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TYPE_CHECKING

from gravity_comp_ros.data.differentiation import differentiate, is_inconsistent, slope_ratios
from gravity_comp_ros.data.gate import apply_gate, GateOptions, GateResult
from gravity_comp_ros.data.runs import Block, blocks_to_hold_out, numbers_in, within
from gravity_comp_ros.data.samples import BoolArray, concatenate, FloatArray, JointSamples
from gravity_comp_ros.display import Displayable, TextTable
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from gravity_comp_ros.printable import counted
import numpy as np
from numpy.typing import ArrayLike
if TYPE_CHECKING:
    # Imports file-format libraries, which arrays do not need.
    from gravity_comp_ros.recordings.bag import ReadReport

Progress = Callable[[str, float], None]
# One array, or a list with one array per run.
ArrayOrRuns = ArrayLike | Sequence[ArrayLike]


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


def _runs(values: ArrayOrRuns | None, are_several: bool) -> list[FloatArray]:
    """Return one array per run."""
    return [np.asarray(run, dtype=np.float64) for run in (
        values if are_several else [values])]  # type: ignore[union-attr]


def _check_run(run: int, t: FloatArray, q: FloatArray, *others: FloatArray) -> None:
    if q.ndim != 2 or not q.size or t.shape != q.shape[:1] or {x.shape for x in others} != {
            q.shape}:
        raise DataError(f'run {run}: t has shape {t.shape}, q {q.shape}, tau and qd '
                        f'{", ".join(str(x.shape) for x in others)}; expected (samples,) for t '
                        f'and (samples, joints) for all others')
    if not (np.isfinite(t).all() and np.isfinite(q).all()):
        raise DataError(f'run {run}: a value of t or q is not finite')


def _check_velocity(run: int, joints: tuple[str, ...], t: FloatArray, q: FloatArray,
                    qd: FloatArray) -> None:
    ratio, likeness = slope_ratios(t, q, qd)
    for n in np.flatnonzero(is_inconsistent(ratio, likeness)):
        raise DataError(f'run {run}: qd of {joints[n]} contradicts q: it is {ratio[n]:.2g} times '
                        f'its slope. Check the unit, or omit qd to differentiate q')


def _scale(effort_scale: float | Mapping[str, float], joints: tuple[str, ...]) -> FloatArray:
    by_name = effort_scale if isinstance(effort_scale, Mapping) else dict.fromkeys(
        joints, effort_scale)
    unknown = [name for name in by_name if name not in joints]
    if unknown:
        raise ModelMismatchError(f'an effort scale is given for {", ".join(unknown)}; the '
                                 f'joints are {", ".join(joints)}')
    scale = np.array([by_name.get(name, 1.0) for name in joints], dtype=np.float64)
    if not np.isfinite(scale).all() or (scale == 0.0).any():
        raise OptionError(f'effort scale is {effort_scale}; it must be finite and not 0')
    return scale


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
        :raises DataError: if shapes disagree, a value is not finite, time does not increase, or
            qd contradicts the slope of q.
        :raises ModelMismatchError: if `effort_scale` names an unknown joint.
        :raises OptionError: if not exactly one of `t` and `rate` is given, or a scale is invalid.
        """
        if (t is None) == (rate is None):
            raise OptionError('give either the times t in s, or the rate in Hz, not both')
        if rate is not None and not (np.isfinite(rate) and rate > 0.0):
            raise OptionError(f'the rate is {rate} Hz; it must be positive')
        several = isinstance(q, list | tuple) and bool(q) and np.ndim(
            q[0]) == 2  # type: ignore[arg-type]
        positions, torques = _runs(q, several), _runs(tau, several)
        times = [np.arange(len(run)) / rate for run in positions] if rate else _runs(t, several)
        speeds = [] if qd is None else _runs(qd, several)
        if {len(torques), len(times), len(speeds) or len(positions)} != {len(positions)}:
            raise DataError(f'q has {len(positions)} runs, tau {len(torques)}, t {len(times)}'
                            f'{f", qd {len(speeds)}" if speeds else ""}')
        factor, parts = np.pi / 180.0 if degrees else 1.0, []
        for k, (time, position, torque) in enumerate(zip(times, positions, torques)):
            _check_run(k, time, position, torque, *speeds[k:k + 1])
            joints = tuple(names or (f'joint_{n + 1}' for n in range(position.shape[1])))
            position = factor * position
            speed = factor * speeds[k] if speeds else differentiate(time, position)
            if len(joints) != position.shape[1]:
                raise DataError(f'run {k}: {len(joints)} names for {position.shape[1]} joints')
            if speeds:
                _check_velocity(k, joints, time, position, speed)
            # Differentiation gives NaN for an isolated sample. NaN in `qd` itself is an error.
            keep = np.full(len(time), True) if speeds else np.isfinite(speed).all(axis=1)
            parts.append(JointSamples.single_run(
                joints, time[keep] - time[0], position[keep], speed[keep],
                _scale(effort_scale, joints) * torque[keep], f'run {k}', float(time[0])))
        return cls(concatenate(parts), gate)

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
        return slow.select(self.use[numbers_in(self.samples, slow)])

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
        blocks = blocks_to_hold_out(self.slow, fraction, guard)
        holdout = Holdout(fraction, int(within(self.slow, blocks).sum()), blocks)
        train = self.usable & ~within(self.samples, blocks, guard)
        test = self.usable & within(self.samples, blocks)
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
