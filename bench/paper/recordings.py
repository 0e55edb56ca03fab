"""
Public recordings of real arms through every formulation, held out by blocks of time.

They are faster than slow motion, so all samples are used, and each formulation is fitted with and
without the effects that fast motion needs: inertia, Coulomb and viscous friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
import time

from bench.paper.scenes import FloatArray
from gravity_comp_ros.data.holdout import HoldoutOptions, split, within
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.fit_with_effects import fit_with_effects
from gravity_comp_ros.estimation.refit import RefitOptions
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import write_bag
from gravity_comp_ros.recordings.table import read_table, TableOptions
import numpy as np

FORMULATIONS = ('per_joint', 'potential', 'chain', 'auto')
EFFECTS = ('coulomb_friction', 'viscous_friction', 'inertia')
# Path below the folder of recordings, name.
BAGS = (('ur10_excitation/ur10_exciting_trajectory.db3', 'UR10 (motor currents)'),
        ('panda_excitation/panda_exciting_trajectory.db3', 'Franka Panda (torque sensors)'),
        ('lbr_med7/measurements.csv', 'KUKA LBR Med 7 (torque sensors)'))
_RATE = 25.0
_HELD_OUT = HoldoutOptions(fraction=0.25, guard=0.5)


@dataclass(frozen=True)
class Judged:
    """One formulation on one recording; errors (N,) in N·m and over the torque's range."""

    recording: str
    method: str
    n_samples: int
    n_held_out: int
    features: list[int]
    seconds: float
    rmse: FloatArray
    nrmse: FloatArray
    constant: FloatArray
    band: float | None


def read(path: Path) -> JointSamples:
    """Return a recording, thinned to 25 Hz; a table is the Med 7's, in KUKA's sign."""
    if path.suffix == '.csv':
        topic = read_table(path, TableOptions(rate=100.0, position='q_{i}', effort='tau_{i}',
                                              effort_sign=(-1.0,))).topic
        with TemporaryDirectory() as folder:
            write_bag(Path(folder) / 'table.mcap', [topic])
            samples = read_bag(Path(folder) / 'table.mcap').samples
    else:
        samples = read_bag(path).samples
    rate = (samples.n_samples - 1) / float(samples.t[-1] - samples.t[0])
    every = max(1, int(round(rate / _RATE)))
    keep = np.zeros(samples.n_samples, dtype=bool)
    keep[::every] = True
    return samples.select(keep)


def judge(path: Path, name: str, formulations: tuple[str, ...] = FORMULATIONS,
          effects: tuple[bool, ...] = (False, True)) -> list[Judged]:
    """Return every formulation on a recording, without and with effects."""
    samples = read(path)
    parts = split(samples, _HELD_OUT)
    use = ~within(samples, parts.guarded)
    held = within(samples, parts.blocks)
    rows = []
    for formulation in formulations:
        for with_effects in effects if formulation != 'auto' else (False,):
            start = time.perf_counter()
            options = FitOptions(formulation)
            method = formulation
            try:
                if with_effects:
                    method += ' + effects'
                    model = fit_with_effects(
                        samples, parts.fitted, requests(list(EFFECTS), samples.names), options,
                        RefitOptions(slow=None), use).joint.model
                else:
                    model = fit(parts.fitted, options).model
            except GravityCompError as problem:
                print(f'  {name}, {method}: {problem}')
                continue
            seconds = time.perf_counter() - start
            left = (samples.tau - predict_torque(model, samples))[held]
            tau = samples.tau[held]
            rmse = np.sqrt((left ** 2).mean(axis=0))
            band = None
            if model.uncertainty is not None:
                spread = np.hypot(model.predict_std(samples.q[held]), model.noise)
                band = float((np.abs(left) <= 1.96 * spread).mean())
            if formulation == 'auto' and model.formulation != 'auto':
                method = method.replace('auto', f'auto (took {model.formulation})')
            rows.append(Judged(name, method, int(use.sum()), int(held.sum()),
                               model.n_features().tolist(), seconds, rmse,
                               rmse / np.maximum(np.ptp(tau, axis=0), 1e-9),
                               tau.std(axis=0), band))
    return rows
