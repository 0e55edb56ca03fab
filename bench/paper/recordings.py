"""
Errors of every formulation on public recordings of real arms, held out by blocks of time.

The recordings are not slow motion, so all samples are used, and each formulation predicts Coulomb
and viscous friction as well. `auto` predicts gravity alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.paper.scenes import FloatArray
from gravity_comp_ros.data.holdout import blocks_to_hold_out, within
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import write_bag
from gravity_comp_ros.recordings.table import read_table, TableOptions
import numpy as np

FORMULATIONS = ('per_joint', 'potential', 'chain', 'auto')
EFFECTS = ('coulomb_friction', 'viscous_friction')
# Path in the folder of recordings, and title.
BAGS = (('ur10_excitation/ur10_exciting_trajectory.db3', 'UR10 (motor currents)'),
        ('panda_excitation/panda_exciting_trajectory.db3', 'Franka Panda (torque sensors)'),
        ('lbr_med7/measurements.csv', 'KUKA LBR Med 7 (torque sensors)'))
# Sampling rate after thinning, in Hz.
_RATE = 25.0
_HELD_OUT, _GUARD = 0.25, 0.5  # share of the samples; s


@dataclass(frozen=True)
class RecordingResult:
    """
    Held-out errors of one formulation on one recording.

    `rmse` (N,) is in N·m; `constant` is the error of the mean torque; `band` is the coverage of
    the 95 % band.
    """

    recording: str
    method: str
    n_samples: int
    n_held_out: int
    rmse: FloatArray
    constant: FloatArray
    band: float | None


def read(path: Path) -> JointSamples:
    """Return a recording, thinned to 25 Hz; a CSV is the Med 7's, in KUKA's sign convention."""
    if path.suffix == '.csv':
        topic = read_table(path, TableOptions(rate=100.0, position='q_{i}', effort='tau_{i}',
                                              effort_sign=(-1.0,))).topic
        with TemporaryDirectory() as folder:
            write_bag(Path(folder) / 'table.mcap', [topic])
            samples = read_bag(Path(folder) / 'table.mcap').samples
    else:
        samples = read_bag(path).samples
    rate = (samples.n_samples - 1) / float(samples.t[-1] - samples.t[0])
    step = max(1, int(round(rate / _RATE)))
    keep = np.zeros(samples.n_samples, dtype=bool)
    keep[::step] = True
    return samples.select(keep)


def evaluate(path: Path, name: str,
             formulations: tuple[str, ...] = FORMULATIONS) -> list[RecordingResult]:
    """Return the results of every formulation on a recording."""
    samples = read(path)
    blocks, guarded = blocks_to_hold_out(samples, _HELD_OUT, _GUARD)
    use, held = ~within(samples, guarded), within(samples, blocks)
    rows = []
    for formulation in formulations:
        options = FitOptions(formulation)
        method = formulation
        try:
            if formulation != 'auto':
                method += ' + effects'
                model = refit(
                    samples, fit(samples, options, use=use).model,
                    requests(list(EFFECTS), samples.names), use=use).model
            else:
                model = fit(samples.select(use), options).model
        except GravityCompError as problem:
            print(f'  {name}, {method}: {problem}')
            continue
        residual = (samples.tau - predict_torque(model, samples))[held]
        rmse = np.sqrt((residual ** 2).mean(axis=0))
        band = None
        if model.covariance is not None:
            spread = np.hypot(model.predict_std(samples.q[held]), model.noise)
            band = float((np.abs(residual) <= 1.96 * spread).mean())
        if formulation == 'auto':
            method = f'auto (selected {model.formulation})'
        rows.append(RecordingResult(
            name, method, int(use.sum()), int(held.sum()), rmse,
            samples.tau[held].std(axis=0), band))
    return rows
