"""
Check of velocity against position, for drivers that publish 0, counts per second or degrees.

The measured qd is compared with the slope of q between consecutive samples with sufficient
motion. The ratio b of qd = b dq/dt is fitted through the origin; it should be 1.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
import numpy as np

# Minimum step between samples, in rad; a smaller one may be encoder noise.
_MIN_STEP = 2e-4
_MIN_STEPS = 20
# Bounds of qd / (dq/dt) for consistent velocities.
_MIN_RATIO, _MAX_RATIO = 0.5, 2.0


def velocity_ratio(samples: JointSamples) -> FloatArray:
    """
    Return the ratio of qd to dq/dt of each joint (N,), from a fit through the origin.

    NaN if a joint moves too little, or if all velocities are 0.
    """
    ratio = np.full(samples.n_joints, np.nan)
    if samples.n_samples < 2 or not samples.qd.any():
        return ratio
    same_run = np.diff(samples.runs) == 0
    dt = np.diff(samples.t)[same_run]
    steps = np.diff(samples.q, axis=0)[same_run]
    speed = 0.5 * (samples.qd[1:] + samples.qd[:-1])[same_run]
    # The mean slope over a gap is not the velocity.
    near = dt <= 3.0 * np.median(dt) if dt.size else np.zeros(0, dtype=bool)
    for n in range(samples.n_joints):
        use = near & (np.abs(steps[:, n]) > _MIN_STEP)
        if use.sum() >= _MIN_STEPS:
            slope = steps[use, n] / dt[use]
            ratio[n] = float(speed[use, n] @ slope / (slope @ slope))
    return ratio


def checked_velocity(samples: JointSamples) -> tuple[JointSamples, str]:
    """
    Return the samples with velocities consistent with positions, and a warning or ''.

    Inconsistent velocities are replaced by the slope of the positions.
    """
    ratio = velocity_ratio(samples)
    inconsistent = np.flatnonzero((ratio < _MIN_RATIO) | (ratio > _MAX_RATIO))
    if not inconsistent.size:
        return samples, ''
    qd = samples.qd.copy()
    for run in run_slices(samples):
        slope = np.nan_to_num(differentiate(samples.t[run], samples.q[run]), nan=0.0)
        for n in inconsistent:
            qd[run, n] = slope[:, n]
    names = ', '.join(f'{samples.names[n]} ({ratio[n]:.2g} times)' for n in inconsistent)
    return replace(samples, qd=qd), (
        f'velocity contradicts position on {names}: the slope of the positions is used instead. '
        f'Check the units of velocity in the driver')
