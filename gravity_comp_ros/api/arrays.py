"""Conversion of NumPy arrays to joint samples: several runs, units, missing velocities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
import numpy as np
from numpy.typing import ArrayLike

# One array, or a list with one array per run.
ArrayOrRuns = ArrayLike | Sequence[ArrayLike]


def samples_from_arrays(q: ArrayOrRuns, tau: ArrayOrRuns, t: ArrayOrRuns | None,
                        qd: ArrayOrRuns | None, rate: float | None,
                        names: Sequence[str] | None, degrees: bool,
                        effort_scale: float | Mapping[str, float]) -> JointSamples:
    """
    Return the samples; parameters as in `Recording.from_arrays`.

    :raises DataError: if shapes disagree or a value is invalid.
    :raises OptionError: if an option is invalid.
    """
    runs_q = _runs('q', q, 2)
    runs_tau = _runs('tau', tau, 2, len(runs_q))
    runs_qd = None if qd is None else _runs('qd', qd, 2, len(runs_q))
    times = _times(t, rate, runs_q)
    joints = _names(names, runs_q)
    scale, factor = _scale(effort_scale, joints), np.pi / 180.0 if degrees else 1.0
    parts = []
    for k, (time, positions, torque) in enumerate(zip(times, runs_q, runs_tau)):
        position = factor * positions
        speed = differentiate(time, position) if runs_qd is None else factor * runs_qd[k]
        if torque.shape != position.shape or speed.shape != position.shape:
            raise DataError(f'run {k}: q has shape {position.shape}, tau {torque.shape}, '
                            f'qd {speed.shape}; they must be the same')
        # Differentiation gives NaN for an isolated sample. NaN in `qd` itself is an error.
        keep = np.isfinite(speed).all(axis=1) if runs_qd is None else np.full(len(time), True)
        parts.append(JointSamples.single_run(joints, time[keep], position[keep], speed[keep],
                                             scale * torque[keep], f'run {k}', 0.0))
    return concatenate(parts)


def _runs(what: str, values: ArrayOrRuns, ndim: int,
          expected: int | None = None) -> list[FloatArray]:
    """Return one array of `ndim` dimensions per run."""
    several = isinstance(values, list | tuple) and bool(values) and np.ndim(
        values[0]) == ndim  # type: ignore[arg-type]
    runs = [np.asarray(run, dtype=np.float64) for run in (
        values if several else [values])]  # type: ignore[union-attr]
    for number, run in enumerate(runs):
        if run.ndim != ndim:
            raise DataError(f'{what} of run {number} has shape {run.shape}; expected '
                            f'{"(samples, joints)" if ndim == 2 else "(samples,)"}')
    if expected is not None and len(runs) != expected:
        raise DataError(f'{what} has {len(runs)} runs, q has {expected}')
    return runs


def _times(t: ArrayOrRuns | None, rate: float | None, q: list[FloatArray]) -> list[FloatArray]:
    if (t is None) == (rate is None):
        raise OptionError('give either the times t in s, or the rate in Hz, not both')
    if rate is not None:
        if not (np.isfinite(rate) and rate > 0.0):
            raise OptionError(f'the rate is {rate} Hz; it must be positive')
        return [np.arange(len(run)) / rate for run in q]
    assert t is not None
    times = _runs('t', t, 1, len(q))
    for number, (time, run) in enumerate(zip(times, q)):
        if len(time) != len(run):
            raise DataError(f'run {number}: t has {len(time)} values, q has {len(run)} rows')
    return times


def _names(names: Sequence[str] | None, q: list[FloatArray]) -> tuple[str, ...]:
    n = q[0].shape[1]
    if any(run.shape[1] != n for run in q):
        raise DataError(f'the runs have {", ".join(str(run.shape[1]) for run in q)} joints; '
                        'all runs must have the same joints')
    if names is None:
        return tuple(f'joint_{k + 1}' for k in range(n))
    if len(names) != n:
        raise DataError(f'{len(names)} names for {n} joints')
    return tuple(names)


def _scale(effort_scale: float | Mapping[str, float], joints: tuple[str, ...]) -> FloatArray:
    if isinstance(effort_scale, Mapping):
        unknown = [name for name in effort_scale if name not in joints]
        if unknown:
            raise ModelMismatchError(f'an effort scale is given for {", ".join(unknown)}; the '
                                     f'joints are {", ".join(joints)}')
        scale = np.array([effort_scale.get(name, 1.0) for name in joints])
    else:
        scale = np.full(len(joints), float(effort_scale))
    if not np.isfinite(scale).all() or (scale == 0.0).any():
        raise OptionError(f'effort scale is {effort_scale}; it must be finite and not 0')
    return scale
