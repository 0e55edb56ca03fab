"""
Velocities that contradict positions: a driver that publishes 0, counts per second or degrees.

The measured qd is compared with the slope of q between neighbouring samples, where the joint moves
far enough to tell. The slope qd = b dq/dt is fitted through the origin; b should be 1.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
import numpy as np

# A step of less than this (rad) may be an encoder's noise.
_STEP = 2e-4
_FEWEST = 20
# qd / (dq/dt) outside these bounds contradicts the positions.
_LEAST, _MOST = 0.5, 2.0


def velocity_ratio(samples: JointSamples) -> FloatArray:
    """
    Return qd over dq/dt of each joint (N,), from a fit through the origin.

    NaN where a joint moves too little to tell, or no speed is recorded for any joint.
    """
    ratio = np.full(samples.n_joints, np.nan)
    if samples.n_samples < 2 or not samples.qd.any():
        return ratio
    same_run = np.diff(samples.runs) == 0
    dt = np.diff(samples.t)[same_run]
    steps = np.diff(samples.q, axis=0)[same_run]
    speed = 0.5 * (samples.qd[1:] + samples.qd[:-1])[same_run]
    # Samples between which others were dropped do not tell a speed.
    near = dt <= 3.0 * np.median(dt) if dt.size else np.zeros(0, dtype=bool)
    for n in range(samples.n_joints):
        use = near & (np.abs(steps[:, n]) > _STEP)
        if use.sum() >= _FEWEST:
            slope = steps[use, n] / dt[use]
            ratio[n] = float(speed[use, n] @ slope / (slope @ slope))
    return ratio


def checked_velocity(samples: JointSamples) -> tuple[JointSamples, str]:
    """
    Return the samples with speeds that agree with their positions, and a warning if some did not.

    Speeds that contradict the positions are replaced by the slope of the positions.
    """
    ratio = velocity_ratio(samples)
    wrong = np.flatnonzero((ratio < _LEAST) | (ratio > _MOST))
    if not wrong.size:
        return samples, ''
    qd = samples.qd.copy()
    for run in run_slices(samples):
        slope = np.nan_to_num(differentiate(samples.t[run], samples.q[run]), nan=0.0)
        for n in wrong:
            qd[run, n] = slope[:, n]
    names = ', '.join(f'{samples.names[n]} ({ratio[n]:.2g} times)' for n in wrong)
    return replace(samples, qd=qd), (
        f'velocity contradicts position on {names}: the slope of the positions is used instead. '
        f'Check the units of velocity in the driver')
