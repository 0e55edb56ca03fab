"""Slow-motion gate: selection of samples without inertia, by message or by run."""

from __future__ import annotations

from dataclasses import asdict, dataclass
import math
from typing import Any

from gravity_comp_ros.data.differentiation import with_accelerations
from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.printable import counted
import numpy as np

FAST = 'fast'
RATE = 'rate'


@dataclass(frozen=True)
class GateOptions:
    """
    Thresholds of the gate.

    `max_speed` in rad/s is one number for all joints or one per joint. One slow sample is kept in
    each interval of 1 / `rate_hz` seconds, all if it is None.

    The default speed keeps all samples of Yu 2022, Eq. (17), (up to 0.12 rad/s).

    :raises OptionError: if a threshold or the rate is not a positive number.
    """

    max_speed: float | tuple[float, ...] = 0.15
    rate_hz: float | None = 5.0

    def __post_init__(self) -> None:
        check_positive(self, 'gate', *(n for n, x in vars(self).items() if x is not None))

    @property
    def limits(self) -> str:
        """Return the thresholds of speed as text, in rad/s."""
        return ', '.join(f'{speed:g}' for speed in np.ravel(self.max_speed))

    def speeds(self, n_joints: int) -> FloatArray:
        """
        Return the maximum speed of each joint, (N,) in rad/s.

        :raises OptionError: if the number of thresholds is not `n_joints`.
        """
        limit = self.max_speed
        if isinstance(limit, tuple) and len(limit) != n_joints:
            raise OptionError(f'gate: max_speed has {len(limit)} values for {n_joints} joints; '
                              'give one for all or one per joint')
        return np.broadcast_to(np.asarray(limit, dtype=np.float64), (n_joints,))


@dataclass(frozen=True, eq=False)
class GateResult:
    """
    Samples that passed the gate, out of `total`, and the number dropped by reason.

    `options` are None without a gate.
    """

    samples: JointSamples
    total: int
    dropped: dict[str, int]
    options: GateOptions | None

    @property
    def kept(self) -> int:
        """Return the number of samples that passed."""
        return self.samples.n_samples

    def to_json(self) -> dict[str, Any]:
        """Return the gate entry of a model's provenance and of `--json`."""
        limits = {} if self.options is None else asdict(self.options)
        return {'total': self.total, 'kept': self.kept, 'dropped': self.dropped,
                'all_samples': self.options is None, **limits}

    def sentence(self) -> str:
        """Return one line with the number of samples kept, and of those dropped by reason."""
        if self.options is None:
            return f'{counted(self.total, "sample")} used, including fast ones'
        reasons = ', '.join(f'{count} {reason}' for reason, count in self.dropped.items())
        return (f'{self.kept} of {counted(self.total, "sample")} pass the slow-motion gate'
                f'{f" ({reasons})" if reasons else ""}')


class Gate:
    """
    The gate for single messages of a run, finite and in order of time.

    :param n_joints: the number N of joints.
    :raises OptionError: if the options have another number of thresholds.
    """

    def __init__(self, n_joints: int, options: GateOptions = GateOptions()) -> None:
        self._options = options
        self._max_speed = options.speeds(n_joints)
        self.reset()

    def reset(self) -> None:
        """Start a new run with the next sample."""
        self._first = math.nan
        self._last_slot = -1

    def offer(self, t: float, qd: FloatArray) -> str | None:
        """
        Return None if the sample passes, else the reason.

        :param t: time in s.
        :param qd: velocities (N,) in rad/s.
        """
        if math.isnan(self._first):
            self._first = t
        if not (np.abs(qd) <= self._max_speed).all():
            return FAST
        if self._options.rate_hz is not None:
            # Slots are centred on multiples of the period, so that input at the requested rate
            # passes completely in spite of jitter in its stamps.
            slot = math.floor((t - self._first) * self._options.rate_hz + 0.5)
            if slot <= self._last_slot:
                return RATE
            self._last_slot = slot
        return None


def slow_samples(samples: JointSamples, options: GateOptions = GateOptions()) -> GateResult:
    """
    Return the samples that pass the gate, with their accelerations if the rate resolves these.

    The gate starts again with every run.

    :raises OptionError: if the options have another number of thresholds than joints.
    """
    fast = np.any(np.abs(samples.qd) > options.speeds(samples.n_joints), axis=1)
    kept = np.zeros_like(fast)
    for run in run_slices(samples):
        slow = run.start + np.flatnonzero(~fast[run])
        kept[slow[_one_per_slot(samples.t[slow], samples.t[run.start], options.rate_hz)]] = True
    dropped = {FAST: fast, RATE: ~(fast | kept)}
    return GateResult(with_accelerations(samples.select(kept), samples), len(samples),
                      {reason: int(lost.sum()) for reason, lost in dropped.items() if lost.any()},
                      options)


def apply_gate(samples: JointSamples, options: GateOptions | None) -> GateResult:
    """
    Return the samples that pass the gate; all of them if `options` is None.

    :raises DataError: if none passes.
    """
    if options is None:
        return GateResult(with_accelerations(samples, samples), samples.n_samples, {}, None)
    result = slow_samples(samples, options)
    if not result.kept:
        raise DataError(f'none of the {samples.n_samples} samples is slow (every joint under '
                        f'{options.limits} rad/s): record slow motion, raise the limit '
                        f'(--max-speed, GateOptions.max_speed), or use all samples '
                        f'(--all-samples, gate=None)')
    return result


def _one_per_slot(t: FloatArray, first: float, rate_hz: float | None) -> BoolArray:
    """Return the mask (M,) of the first sample of each period, counted from `first` s."""
    if rate_hz is None:
        return np.ones(len(t), dtype=bool)
    slots = np.floor((t - first) * rate_hz + 0.5)
    return np.diff(slots, prepend=-1.0) > 0.0
