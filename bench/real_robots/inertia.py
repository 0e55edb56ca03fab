"""
Gravity learned from slow motion with inertia, on descriptions of real robots.

Run from the root of the repository:

    python -m bench.real_robots.inertia results/ --seeds 400

One run of 100 s at 5 Hz of every arm (500 samples, as in the training of Yu 2022), a multisine
anywhere within the joint limits at up to 0.2 rad/s, full rigid-body dynamics, noise as in
`cases`, no friction and no hidden effect. The gate of slow samples is wide enough for all of them,
as with `fit --max-speed 0.25`: at the default of 0.15 rad/s a quarter of the samples is not
fitted, and the fastest parts of the range are extrapolated. The error is that of the gravity
torque of `fit` over 1000 poses within the whole joint limits, which the motion covers in part: rms
of the worst joint, in percent of the arm's largest gravity torque. The floor is the error of least
squares on Pinocchio's regressor with the exact motion and the true noise.
"""

from __future__ import annotations

import sys

from bench.real_robots.arms import arm_of, described, urdf
from bench.real_robots.cases import generator, recorded, regressor, scales
from bench.real_robots.product import recording
from bench.real_robots.run import arms_and_seeds, each, rms
from bench.shared.runner import extremes, figures, Result, run
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, gravity_torque
from gravity_comp_ros.simulation.motions import Motion, multisine, MultisineOptions
import numpy as np

_DURATION, _RATE, _SPEED, _POSES = 100.0, 5.0, 0.2, 1000
_GATE = gc.GateOptions(max_speed=0.25)


def errors_of(name: str, seed: int) -> Result:
    """Return the floor, and the error and its ratio to it without and with the description."""
    arm, rng = arm_of(urdf(name)), generator(name, seed, 1)
    scale, largest = scales(arm)
    noise = rng.uniform(0.001, 0.002, arm.n_joints) * scale
    motion = multisine(arm.lower, arm.upper, arm.max_speed, int(rng.integers(2 ** 31)),
                       MultisineOptions(_SPEED, _DURATION), _DURATION, _RATE)
    one = recorded(arm, motion, (), noise, rng)
    q = rng.uniform(arm.lower, arm.upper, (_POSES, arm.n_joints))
    truth = gravity_torque(arm, q)
    data = recording(arm.joints, [one], _GATE)
    bound = rms(floor(arm, motion, one.tau, noise, q), truth, largest)
    with described(urdf(name), seed) as path:
        models = {'fit': gc.fit(data), 'described': gc.fit(data, urdf=path)}
    result = {'floor %': bound}
    for title, model in models.items():
        error = rms(model.predict(q), truth, largest)
        result |= {f'{title} %': error, f'{title} x floor': error / bound}
    return result


def floor(arm: Arm, motion: Motion, tau: FloatArray, noise: FloatArray,
          q: FloatArray) -> FloatArray:
    """Return the gravity (K, N) in N·m in poses q of least squares with known dynamics."""
    columns = regressor(arm, motion) / noise[:, None]
    flat = columns.reshape(-1, columns.shape[2])
    # Parameters that no torque depends on have the eigenvalue 0.
    inverse = np.linalg.pinv(flat.T @ flat, rcond=1e-12, hermitian=True)
    x = inverse @ (flat.T @ (tau / noise).ravel())
    still = Motion('poses', np.arange(len(q), dtype=np.float64), q, 0 * q, 0 * q,
                   lambda t: (q, 0 * q, 0 * q))
    return np.asarray(regressor(arm, still) @ x)


if __name__ == '__main__':
    sys.exit(run(__doc__, arms_and_seeds, each, errors_of, figures, extremes))
