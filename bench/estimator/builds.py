"""Arms and motions for the accuracy of the estimator: a tuning set and a test set."""

from __future__ import annotations

from dataclasses import dataclass

from bench.cases import generated
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.kinematic.chain import aligned, Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Nuisance, solve
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.arms import Arm, with_base_tilt
import numpy as np
import pinocchio as pin

# Standard deviation of the torque in N·m, sampling rate in Hz, duration of the motion in s.
NOISE = 0.1
RATE = 5.0
DURATION = 100.0
# Prior standard deviation of friction coefficients that are practically free, per N·m of noise.
FREE = 1e6
# Number of test poses over the whole joint range.
RANGE_POSES = 1000


@dataclass(frozen=True)
class Build:
    """An arm, the seed of its slow motion, and whether it is in the tuning set."""

    name: str
    arm: Arm
    seed: int
    tuning: bool


def shoulder_arm(seed: int) -> Arm:
    """
    Return a seven-axis arm of a two-armed robot, with a shoulder at a random angle.

    Upper arm and forearm are long; wrist axes meet at right angles; every axis is off by up to
    three degrees, as in assembly.
    """
    rng = np.random.default_rng([seed, 7])
    angles = [(rng.uniform(-1.2, 1.2), rng.uniform(-1.2, 1.2)), (np.pi / 2, 0.0),
              (-np.pi / 2, 0.0), (np.pi / 2, 0.0), (-np.pi / 2, 0.0), (np.pi / 2, 0.0),
              (-np.pi / 2, 0.0)]
    lengths = rng.uniform(0.7, 1.3, 7) * np.array([0.1, 0.07, 0.36, 0.07, 0.37, 0.02, 0.12])
    masses = rng.uniform(0.7, 1.3, 7) * np.array([5.7, 3.2, 4.3, 2.0, 2.2, 1.6, 0.5])
    model, parent = pin.Model(), 0
    names = tuple(f'arm_{k + 1}' for k in range(7))
    for k, name in enumerate(names):
        roll, pitch = angles[k] + rng.normal(scale=1e-3, size=2)
        # Long links run along their own axis, short ones across it.
        along = np.array([0.0, 0.0, 1.0]) if k % 2 == 0 else np.array([1.0, 0.0, 0.0])
        place = pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, 0.0), lengths[k] * along)
        parent = model.addJoint(parent, pin.JointModelRZ(), place, name)
        centre = 0.5 * lengths[min(k + 1, 6)] * along + rng.normal(scale=0.02, size=3)
        model.appendBodyToJoint(parent, pin.Inertia(masses[k], centre, 0.02 * np.eye(3)),
                                pin.SE3.Identity())
    limit = np.full(7, 2.5)
    return Arm(f'shoulder_{seed}', names, model, -limit, limit, np.full(7, 1.5))


def builds() -> list[Build]:
    """Return all builds: the tuning set, then the test set."""
    tuning = [Build(f'any angle {seed}', generated.generated_arm(seed), seed, True)
              for seed in range(4)]
    tuning += [Build(f'right angles {seed}', generated.generated_arm(seed, right_angles=True),
                     seed, True) for seed in range(4)]
    tuning += [Build('iiwa', arms.iiwa7(), 1, True), Build('shoulder 0', shoulder_arm(0), 0, True)]
    judging = [Build(f'any angle {seed}', generated.generated_arm(seed), seed, False)
               for seed in range(100, 104)]
    judging += [Build(f'right angles {seed}', generated.generated_arm(seed, right_angles=True),
                      seed, False) for seed in range(100, 104)]
    judging += [Build(f'shoulder {seed}', shoulder_arm(seed), seed, False)
                for seed in range(100, 103)]
    judging += [Build('iiwa tilted', with_base_tilt(arms.iiwa7(), 0.5, -0.3), 101, False)]
    return tuning + judging


def true_axes(arm: Arm) -> np.ndarray:
    """Return the true axes (N, 3, 3) of an arm, with the tilt of its base."""
    axes = np.stack([p.rotation for p in list(arm.model.jointPlacements)[1:]])
    up = -arm.model.gravity.linear
    axes[0] = aligned(up / np.linalg.norm(up)).T @ axes[0]
    return axes


def fit_on_axes(axes: np.ndarray, samples: JointSamples,
                nuisance: np.ndarray | None = None) -> Chain:
    """
    Return the least-squares chain on known axes, fitted jointly with nuisance columns.

    :param nuisance: (N, C, M), of each joint.
    """
    n = samples.n_joints
    columns = ForwardKinematics(axes, samples.q).moment_columns()
    if nuisance is not None:
        of_joints = np.einsum('ncm,nj->ncjm', nuisance, np.eye(n))
        columns = np.concatenate([columns, of_joints.reshape(-1, *columns.shape[1:])])
    columns = columns.reshape(len(columns), -1) / NOISE
    gram = columns @ columns.T + 1e-4 * np.eye(len(columns))
    x = np.linalg.solve(gram, columns @ (samples.tau.T.ravel() / NOISE))
    return Chain(axes, x[:2 * n].reshape(n, 2))


@dataclass(frozen=True)
class Case:
    """A build with friction and noise: its samples, test poses, and bounds of the error."""

    build: Build
    friction: float
    noise_seed: int

    def motion(self, start: float = 0.0, duration: float = DURATION) -> motions.Motion:
        """Return slow motion as in Yu 2022, or random sines for even seeds of the test set."""
        build = self.build
        if build.tuning or build.seed % 2:
            return generated.small_motion(build.arm, build.seed, duration, RATE, start)
        options = motions.MultisineOptions(max_speed=0.15)
        arm = build.arm
        return motions.multisine(0.3 * arm.lower, 0.3 * arm.upper, arm.max_speed, build.seed,
                                 options, duration, RATE, start)

    def sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return Coulomb (N,) in N·m and viscous friction (N,) in N·m·s/rad."""
        span = np.ptp(arms.gravity_torque(self.build.arm, self.poses()), axis=0)
        return self.friction * span, self.friction * span / 0.15

    def samples(self, start: float = 0.0, duration: float = DURATION, payload=None,
                arm: Arm | None = None) -> JointSamples:
        """Return the samples; friction reverses over 2 mrad/s, noise is white."""
        motion = self.motion(start, duration)
        arm = arm or self.build.arm
        rng = np.random.default_rng([self.noise_seed, self.build.seed, int(start)])
        tau = arms.gravity_torque(arm, motion.q)
        coulomb, viscous = self.sizes()
        tau = tau + coulomb * motion.qd / np.hypot(motion.qd, 0.002) + viscous * motion.qd
        tau = tau + NOISE * rng.normal(size=tau.shape)
        return JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)

    def poses(self) -> np.ndarray:
        rng = np.random.default_rng(1234)
        return rng.uniform(self.build.arm.lower, self.build.arm.upper,
                           (RANGE_POSES, self.build.arm.n_joints))

    def error(self, predict, q: np.ndarray, arm: Arm | None = None) -> np.ndarray:
        """Return each joint's RMSE of gravity in N·m at poses q."""
        residual = predict(q) - arms.gravity_torque(arm or self.build.arm, q)
        return np.sqrt((residual ** 2).mean(axis=0))

    def nuisance(self, samples: JointSamples) -> np.ndarray:
        """Return the columns (N, C, M) of friction of each joint; C is 0 without friction."""
        qd = samples.qd.T
        columns = np.stack([qd, qd / np.hypot(qd, 0.002)], axis=1)
        return columns if self.friction else columns[:, :0]

    def limit(self, samples: JointSamples) -> float:
        """
        Return the Cramer-Rao bound of the worst joint's RMS error with unknown axes.

        No unbiased estimate of moments and axes has a smaller error over many noise realisations.
        (An estimate that assumes right angles is biased, and more accurate if they are right.)
        """
        columns = self.nuisance(samples)
        nuisance = Nuisance(columns, np.full(columns.shape[1], FREE))
        problem = ChainProblem(samples.q, samples.tau, np.full(samples.tau.shape, 1.0 / NOISE),
                               nuisance)
        solution = solve(problem, true_axes(self.build.arm))
        jacobian = solution.chain.jacobian(self.poses())
        covariance = np.linalg.inv(solution.precision)
        variance = np.einsum('anm,ab,bnm->nm', jacobian, covariance, jacobian, optimize=True)
        return float(np.sqrt(variance.mean(axis=1)).max())

    def floor(self, samples: JointSamples) -> float:
        """Return the worst joint's error of least squares with known axes and friction."""
        chain = fit_on_axes(true_axes(self.build.arm), samples, self.nuisance(samples))
        return float(self.error(chain.torque, self.poses()).max())
