"""`JointSamples`: samples of joint motion, the data type of the whole package."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from os.path import commonprefix
import re
from typing import Any
from zlib import crc32

from gravity_comp_ros.errors import DataError, ModelMismatchError
import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_ONE_TIME, _ONE_RUN = np.zeros(1), np.zeros(1, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class JointSamples:
    """
    M immutable samples of N joints, from one or several runs.

    `names` has N unique joint names; `t` (M,) is time in s, strictly increasing within a run;
    `q` (M, N) in rad, `qd` (M, N) in rad/s and `tau` (M, N) in N·m (the torque of the drive:
    positive tau accelerates q upwards). `runs` (M,) is the run number of each sample, in
    non-decreasing order from 0; `run_labels` are the names of the runs. Samples of a run are in
    order of time. `starts` has for each run the time on a common clock, in s, at which its t is
    0; it is empty without a known clock. `qdd` (M, N) in rad/s^2 are accelerations at the rate of
    the recording from which the samples were selected, None where they are unknown.
    `fingerprints` has a number for each run that names the recording, whatever its clock; it is
    empty if they are unknown. Arrays are finite and read-only.

    :raises DataError: if shapes disagree, a value is not finite, names repeat, or time does
        not increase within a run.
    """

    names: tuple[str, ...]
    t: FloatArray
    q: FloatArray
    qd: FloatArray
    tau: FloatArray
    runs: IntArray
    run_labels: tuple[str, ...]
    starts: tuple[float, ...] = ()
    qdd: FloatArray | None = None
    fingerprints: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        values = {'names': tuple(str(name) for name in self.names),
                  'run_labels': tuple(str(label) for label in self.run_labels),
                  'runs': _frozen(self.runs, np.int64),
                  'starts': tuple(float(start) for start in self.starts),
                  **{field: _frozen(getattr(self, field), np.float64)
                     for field in self._arrays()}}
        for field, value in values.items():
            object.__setattr__(self, field, value)
        _check_names(self.names)
        self._check_shapes()
        self._check_values()
        if self.starts and (len(self.starts) != self.n_runs
                            or not np.isfinite(self.starts).all()):
            raise DataError(f'samples: starts must be one finite time for each of '
                            f'{self.n_runs} runs, or none')
        if self.fingerprints and len(self.fingerprints) != self.n_runs:
            raise DataError(f'samples: fingerprints must be one for each of {self.n_runs} runs, '
                            f'or none')

    def _arrays(self) -> tuple[str, ...]:
        """Return the names of the arrays of numbers."""
        return ('t', 'q', 'qd', 'tau') if self.qdd is None else ('t', 'q', 'qd', 'tau', 'qdd')

    def _check_shapes(self) -> None:
        m, n = self.t.shape[0] if self.t.ndim == 1 else -1, len(self.names)
        for field in (*self._arrays(), 'runs'):
            shape = (m,) if field in ('t', 'runs') else (m, n)
            actual = getattr(self, field).shape
            if m < 0 or actual != shape:
                raise DataError(f'samples: {field} has shape {actual}; expected {shape} for '
                                f'{n} joints')
        if m and (self.runs[0] < 0 or np.any(np.diff(self.runs) < 0)
                  or self.runs[-1] >= len(self.run_labels)):
            raise DataError(f'samples: run numbers must rise from 0 and stay under the '
                            f'{len(self.run_labels)} run labels')

    def _check_values(self) -> None:
        for field in self._arrays():
            values = getattr(self, field)
            if not np.isfinite(values).all():
                where = np.argwhere(~np.isfinite(values))[0]
                joint = f' of joint {self.names[where[1]]}' if where.size > 1 else ''
                raise DataError(f'samples: {field}{joint} is not finite at sample {where[0]}')
        backwards = (np.diff(self.t) <= 0) & (np.diff(self.runs) == 0)
        if backwards.any():
            where = int(np.flatnonzero(backwards)[0]) + 1
            raise DataError(f'samples: time does not increase at sample {where} '
                            f'(run {self.run_labels[self.runs[where]]})')

    @classmethod
    def single_run(cls, names: Sequence[str], t: ArrayLike, q: ArrayLike, qd: ArrayLike,
                   tau: ArrayLike, label: str = 'run', start: float | None = None,
                   qdd: ArrayLike | None = None) -> JointSamples:
        """
        Return the samples of one run; arrays as in the class.

        :param start: the time on a clock in s at which t is 0, if one is known.
        """
        t, q, tau = (np.asarray(x, dtype=np.float64) for x in (t, q, tau))
        number = crc32(np.ascontiguousarray(tau).data, crc32(np.ascontiguousarray(q).data))
        return cls(tuple(names), t, q, np.asarray(qd, dtype=np.float64), tau,
                   np.zeros(t.shape, dtype=np.int64), (label,),
                   () if start is None else (start,),
                   None if qdd is None else np.asarray(qdd, dtype=np.float64), (number,))

    @classmethod
    def at_rest(cls, names: Sequence[str], q: FloatArray) -> JointSamples:
        """Return poses q (M, N) at rest, one each second, without torque."""
        still = np.zeros_like(q)
        return cls.single_run(names, np.arange(len(q)), q, still, still)

    @classmethod
    def single_sample(cls, names: tuple[str, ...], q: FloatArray, qd: FloatArray) -> JointSamples:
        """
        Return one sample of q (N,) and qd (N,), without torque, for a loop at 1 kHz.

        It contains views of the arrays, which must be finite; there are no checks.
        """
        samples = object.__new__(cls)
        samples.__dict__.update(names=names, t=_ONE_TIME, q=q[None], qd=qd[None], runs=_ONE_RUN,
                                tau=np.zeros((1, len(q))), run_labels=('single',), starts=(),
                                qdd=None, fingerprints=())
        return samples

    @property
    def n_samples(self) -> int:
        return int(self.t.shape[0])

    @property
    def n_joints(self) -> int:
        return len(self.names)

    @property
    def n_runs(self) -> int:
        return len(self.run_labels)

    def __len__(self) -> int:
        return self.n_samples

    def select(self, keep: ArrayLike) -> JointSamples:
        """
        Return the selected samples in their order, with all run labels.

        :param keep: boolean mask (M,) or rising sample numbers.
        """
        keep = np.asarray(keep)
        return replace(self, runs=self.runs[keep],
                       **{field: getattr(self, field)[keep] for field in self._arrays()})

    def joints(self, names: Sequence[str]) -> JointSamples:
        """
        Return the same samples with exactly these joints, in this order.

        :raises ModelMismatchError: if a name is not among the joints.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise ModelMismatchError(
                f'no joint {", ".join(missing)} in the data; it has {", ".join(self.names)}'
                + rename_hint(self.names, names))
        if tuple(names) == self.names:
            return self
        order = [self.names.index(name) for name in names]
        return replace(self, names=tuple(names), **{
            field: getattr(self, field)[:, order] for field in self._arrays()[1:]})

    def run(self, number: int) -> JointSamples:
        """Return the samples of one run, as a set with that single run."""
        part, own = self.select(self.runs == number), slice(number, number + 1)
        return replace(part, runs=np.zeros_like(part.runs), run_labels=self.run_labels[own],
                       starts=self.starts[own], fingerprints=self.fingerprints[own])

    def each_run(self) -> Iterator[JointSamples]:
        """Yield every run in order, empty ones included."""
        for number in range(self.n_runs):
            yield self.run(number)


def concatenate(parts: Iterable[JointSamples]) -> JointSamples:
    """
    Return all samples of `parts` as one set, with separate runs.

    Joints are matched by name, in the order of the first part. Accelerations are known if those
    of all parts are.

    :raises DataError: if there are no parts.
    :raises ModelMismatchError: if the joint names of two parts differ.
    """
    parts = list(parts)
    if not parts:
        raise DataError('no samples to join')
    if len(parts) == 1:
        return parts[0]
    names = parts[0].names
    for part in parts[1:]:
        if set(part.names) != set(names):
            raise ModelMismatchError(
                f'runs {parts[0].run_labels[0]} and {part.run_labels[0]} are of different '
                f'robots: joints {", ".join(names)} against {", ".join(part.names)}')
    parts = [part.joints(names) for part in parts]
    accelerations = [part.qdd for part in parts if part.qdd is not None]
    first_run = np.cumsum([0] + [part.n_runs for part in parts[:-1]])
    return JointSamples(
        names, _joined([p.t for p in parts]), _joined([p.q for p in parts]),
        _joined([p.qd for p in parts]), _joined([p.tau for p in parts]),
        _joined([p.runs + k for p, k in zip(parts, first_run)]),
        tuple(label for p in parts for label in p.run_labels),
        _of_all([p.starts for p in parts]),
        _joined(accelerations) if len(accelerations) == len(parts) else None,
        _of_all([p.fingerprints for p in parts]))


def evenly_picked(count: int, max_count: int) -> IntArray:
    """Return the numbers of at most `max_count` of `count` samples, evenly spaced from 0."""
    return np.arange(0, count, -(-max(count, 1) // max_count))


def spread_over(count: int, max_count: int) -> IntArray:
    """Return the numbers of at most `max_count` of `count` samples, the first to the last."""
    return np.unique(np.linspace(0, count - 1, max_count).astype(int))


def _of_all(parts: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Return the values of all runs, none if those of a part are unknown."""
    return tuple(value for part in parts for value in part) if all(parts) else ()


def _joined(parts: list[NDArray]) -> NDArray:
    """Return all parts as one read-only array, which `JointSamples` does not copy again."""
    array = np.concatenate(parts)
    array.flags.writeable = False
    return array


def _check_names(names: tuple[str, ...]) -> None:
    if not names:
        raise DataError('samples: no joints')
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise DataError(f'samples: joint names repeat: {", ".join(repeated)}')


def _frozen(values: ArrayLike, dtype: type) -> NDArray:
    """Return a read-only array, copied unless it is read-only already."""
    array: NDArray = np.asarray(values, dtype=dtype)
    # The base of a read-only view may still be writeable.
    if array.flags.writeable or array.base is not None:
        array = array.copy()
        array.flags.writeable = False
    return array


def joint_named(text: str, joints: Sequence[str]) -> str | None:
    """Return the joint with this name, else with this number, None if there is neither."""
    if text in joints:
        return text
    if text.isdecimal() and 1 <= int(text) <= len(joints):
        return joints[int(text) - 1]
    return None


def rename_hint(known: Sequence[str], wanted: Sequence[str], to_known: bool = False) -> str:
    """
    Return the `--rename` that maps recorded names to wanted ones, '' if the names do not tell.

    Names correspond if they are equal without what all of them have in common at the beginning
    and at the end, as prefixes of a robot.

    :param to_known: whether the wanted names are the recorded ones, and are mapped to known ones.
    """
    pairs = _by_ending(known, wanted) or _by_core(known, wanted)
    if not pairs or len(set(pairs.values())) < len(wanted):
        return ''
    return '; if these are the same joints: --rename ' + ','.join(
        f'{new}={old}' if to_known else f'{old}={new}' for new, old in pairs.items()
        if old != new)


def _by_ending(known: Sequence[str], wanted: Sequence[str]) -> dict[str, str]:
    """Return known names by the wanted ones, of which one ends with the other."""
    pairs = {}
    for new in wanted:
        matches = [old for old in known if _plain(old).endswith(_plain(new))
                   or _plain(new).endswith(_plain(old))]
        if len(matches) != 1:
            return {}
        pairs[new] = matches[0]
    return pairs


def _by_core(known: Sequence[str], wanted: Sequence[str]) -> dict[str, str]:
    """Return known names by the wanted ones, without common beginning and end."""
    cores = dict(zip(_cores(known), known))
    pairs = {new: cores[core] for new, core in zip(wanted, _cores(wanted)) if core in cores}
    return pairs if len(pairs) == len(wanted) and len(cores) == len(known) else {}


def _cores(names: Sequence[str]) -> list[str]:
    plain = [_plain(name) for name in names]
    first = len(commonprefix(plain))
    last = len(commonprefix([name[::-1] for name in plain]))
    return [name[first:len(name) - last] for name in plain]


def _plain(name: str) -> str:
    return re.sub(r'[\W_]', '', name).lower()
