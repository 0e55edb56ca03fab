"""Test arms: an analytic planar arm, and serial arms of any length from Pinocchio."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.kinematic.chain import aligned, Chain
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
import numpy as np
import pinocchio as pin

G = 9.81


def serial_arm(n_joints: int, seed: int = 0) -> Arm:
    """Return a random arm with a vertical first axis and right angles between axes."""
    rng = np.random.default_rng(seed)
    model, parent = pin.Model(), 0
    names = tuple(f'axis{n}' for n in range(n_joints))
    for n, name in enumerate(names):
        rotation = pin.rpy.rpyToMatrix(*rng.choice([0.0, np.pi / 2, -np.pi / 2], 3)) if n \
            else np.eye(3)
        parent = model.addJoint(parent, pin.JointModelRZ(),
                                pin.SE3(rotation, rng.uniform(-0.3, 0.3, 3)), name)
        model.appendBodyToJoint(parent, pin.Inertia(
            rng.uniform(1, 4), rng.uniform(-0.15, 0.15, 3), 0.01 * np.eye(3)),
            pin.SE3.Identity())
    limit = np.full(n_joints, 2.5)
    return Arm('serial', names, model, -limit, limit, limit)


def random_chain(n: int, seed: int) -> Chain:
    """Return a chain with random axes."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Chain(np.stack([aligned(d) for d in directions]), rng.normal(size=(n, 2)))


def planar_2r(q: np.ndarray, m1=3.0, m2=2.0, l1=0.5, c1=0.25, c2=0.2) -> np.ndarray:
    """
    Return the torques (M, 2) of two links in a vertical plane, angles from the horizontal.

    tau_1 = (m1 c1 + m2 l1) g cos q1 + m2 c2 g cos(q1 + q2), tau_2 = m2 c2 g cos(q1 + q2).
    """
    both = m2 * c2 * G * np.cos(q[:, 0] + q[:, 1])
    return np.column_stack([(m1 * c1 + m2 * l1) * G * np.cos(q[:, 0]) + both, both])


def samples_of(q: np.ndarray, tau: np.ndarray, noise: float = 0.0, seed: int = 0,
               names=None) -> JointSamples:
    """Return one run of samples at 5 Hz, with white noise of this std in N·m on the torques."""
    tau = tau + noise * np.random.default_rng(seed).normal(size=tau.shape)
    names = names or tuple(f'axis{n}' for n in range(q.shape[1]))
    return JointSamples.single_run(names, 0.2 * np.arange(len(q)), q, np.zeros_like(q), tau)


def poses(count: int, n_joints: int, seed: int = 0, reach: float = 2.5) -> np.ndarray:
    """Return random poses within ±reach rad, shape (count, n_joints)."""
    return np.random.default_rng(seed).uniform(-reach, reach, (count, n_joints))


def worst(model, arm: Arm, q: np.ndarray) -> float:
    """Return the RMSE in N·m of the worst joint against noise-free gravity."""
    return float(np.sqrt(((model.predict(q) - gravity_torque(arm, q)) ** 2).mean(axis=0)).max())


def geometry_of(arm: Arm) -> Geometry:
    """Return the axes of a simulated arm, in frames with z along the axis."""
    rotations, origins, to_frame = [], [], np.eye(3)
    for joint, placement in list(zip(arm.model.joints, arm.model.jointPlacements))[1:]:
        to_axis = aligned(np.eye(3)['XYZ'.index(joint.shortname()[-1])])
        rotations.append(to_frame @ placement.rotation @ to_axis)
        origins.append(to_frame @ placement.translation)
        to_frame = to_axis.T
    return Geometry(arm.joints, np.array(rotations), np.array(origins), 'hand', to_frame)
