"""
Samples of the iiwa with a payload, and the job of the node's fit process for them.

Slow motion at 5 Hz with 0.1 N·m of noise.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.epoch import DELAYS, Epoch, SlowSample
from gravity_comp_ros.node.job_messages import FitJob
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17, Motion, multisine, MultisineOptions
import numpy as np

RATE, NOISE = 5.0, 0.1
ARM = iiwa7()


@dataclass(frozen=True)
class Case:
    """Samples of one payload, and poses and true torque of the motion that follows."""

    label: str
    samples: JointSamples
    later: FloatArray
    truth: FloatArray


def motion(kind: str, seed: int, seconds: float, start: float) -> Motion:
    """Return slow motion: Eq. (17) of Yu 2022, or a multisine."""
    if kind == 'eq17':
        return eq17(seconds, RATE, start)
    return multisine(0.6 * ARM.lower, 0.6 * ARM.upper, ARM.max_speed, seed,
                     MultisineOptions(max_speed=0.14), seconds, RATE, start)


def recorded(kind: str, seed: int, seconds: float, start: float, payload: Payload | None,
             label: str, rng: np.random.Generator) -> Case:
    """Return the measurements of a motion, and the truth of the next ten seconds."""
    arm = ARM if payload is None else with_payload(ARM, payload)
    whole = motion(kind, seed, seconds + 10.0, start)
    n = round(seconds * RATE)
    tau = gravity_torque(arm, whole.q)
    samples = JointSamples.single_run(arm.joints, whole.t[:n], whole.q[:n], whole.qd[:n],
                                      tau[:n] + NOISE * rng.standard_normal((n, 7)))
    return Case(label, samples, whole.q[n:], tau[n:])


def job_of(case: Case, base: GravityModel, geometry: Geometry | None = None) -> FitJob:
    """Return the fit job that the node submits for these samples."""
    epoch = Epoch(1, case.samples.names, Parameters(sample_rate=RATE), has_base=True)
    none = np.full((len(DELAYS), case.samples.n_joints), np.nan)
    for row in zip(case.samples.t, case.samples.q, case.samples.qd, case.samples.tau):
        epoch.offer(SlowSample(CompleteReading(*row), none))
    return FitJob(epoch.rows(), base, base, geometry=geometry)
