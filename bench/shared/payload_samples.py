"""
Samples of the iiwa with a payload, for the fit process of the node and for `NodeCore`.

Slow motion at 5 Hz with 0.1 N·m of noise, without friction (`recorded`) or with it (`learned`).
"""

from __future__ import annotations

from dataclasses import dataclass

from bench.shared.node_messages import joint_state, send_message
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.checks import FIT, Job
from gravity_comp_ros.node.epoch import Epoch, rows_of, SlowSample
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.simulation.arms import (
    gravity_torque, iiwa7, inverse_dynamics, Payload, with_payload)
from gravity_comp_ros.simulation.motions import eq17, Motion, multisine, MultisineOptions
import numpy as np
import pinocchio as pin

RATE, NOISE = 5.0, 0.1
ARM = iiwa7()
COULOMB = np.array([0.8, 1.2, 0.6, 0.8, 0.3, 0.3, 0.2])
VISCOUS = np.array([2.0, 3.0, 2.0, 2.0, 1.0, 1.0, 0.5])
# Speed over which Coulomb friction changes its sign, rad/s.
WIDTH = 0.005


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


def job_of(case: Case, base: GravityModel, geometry: Geometry | None = None) -> Job:
    """Return the fit job that the node submits for these samples."""
    epoch = Epoch(1, case.samples.names, Parameters(), base)
    none = np.full((2, case.samples.n_joints), np.nan)
    for row in zip(case.samples.t, case.samples.q, case.samples.qd, case.samples.tau):
        epoch.offer(SlowSample(CompleteReading(*row), none))
    return Job(FIT, rows_of(epoch.names, epoch.samples()), base, base, geometry=geometry)


def friction(qd: FloatArray) -> FloatArray:
    """Return the friction (M, N) in N·m at speeds (M, N) in rad/s."""
    return COULOMB * np.tanh(qd / WIDTH) + VISCOUS * qd


def force_torque(q: FloatArray, force: FloatArray) -> FloatArray:
    """Return the torque (N,), N·m, of a force (3,) in base coordinates on the last link."""
    data = ARM.model.createData()
    pin.forwardKinematics(ARM.model, data, q)
    jacobian = pin.computeJointJacobian(ARM.model, data, q, 7)
    return np.asarray((data.oMi[7].rotation @ jacobian[:3]).T @ force)


def learned(rng: np.random.Generator) -> GravityModel:
    """Return the model of the arm with friction and without payload, from 100 s of motion."""
    slow = eq17(100.0, RATE)
    tau = inverse_dynamics(ARM, slow.q, slow.qd, slow.qdd) + friction(slow.qd)
    tau = tau + NOISE * rng.standard_normal(tau.shape)
    return fit(JointSamples.single_run(ARM.joints, slow.t, slow.q, slow.qd, tau),
               FitOptions(formulation='auto')).model


class Core:
    """The node without ROS, with a model in use, a closed epoch and a real fit process."""

    def __init__(self, model: GravityModel) -> None:
        self.live = NodeCore(
            Parameters(joints=ARM.joints, unlimited_torque=True, auto_fit=False, max_age=0.0,
                       stale_action='hold'), '/joint_states', 0.0)
        self.send(0.5, *np.zeros((3, 7)))
        self.live.models.use(model, 'bench', 0.0, -1)
        assert self.live.arm is not None
        self.live.arm.use(model, None, 0)
        self.live.arm.epoch.is_open = False

    def send(self, t: float, q: FloatArray, qd: FloatArray, tau: FloatArray) -> None:
        """Send a measurement to the node."""
        send_message(self.live, joint_state(ARM.joints, t, q, qd, tau), t, t)
