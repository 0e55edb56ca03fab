"""
Other methods: regression with known kinematics, kernel ridge, an explicit formula, a nominal URDF.

- regression: with known kinematics the torque is linear in the masses and first moments of the
  links (Yu 2022, Eq. (19)); least squares on Pinocchio's regressor.
- kernel ridge: one for each joint, on that joint's row of the same regressor. Hyper-parameters by
  cross-validation over blocks of time; the search is included in the time.
- EFD: the explicit formula from D-H parameters, with errors of lengths up to 5 mm, of masses up to
  5 % and of centres up to 1 cm, as from a data sheet and a scale.
- nominal: Pinocchio with the URDF, without a payload.
"""

from __future__ import annotations

import time
from typing import Any

from bench.paper.methods import Fitted
from bench.paper.scenes import FloatArray, Scene
from gravity_comp_ros.models.kinematic.chain import Chain, expand
from gravity_comp_ros.models.kinematic.geometry import STANDARD_GRAVITY
from gravity_comp_ros.simulation import arms
import numpy as np
import pinocchio as pin

# Inertial parameters of a link: the first four (m, m c) determine gravity.
_STATIC, _ALL = 4, 10


def regressors(arm: arms.Arm, q: FloatArray) -> FloatArray:
    """Return d tau / d (m, m c of every link), shape (M, N, 4 N)."""
    data, zero = arm.model.createData(), np.zeros(arm.n_joints)
    rows = [pin.computeJointTorqueRegressor(arm.model, data, pose, zero, zero) for pose in q]
    each = np.array(rows).reshape(len(q), arm.n_joints, arm.n_joints, _ALL)
    return np.ascontiguousarray(each[..., :_STATIC]).reshape(len(q), arm.n_joints, -1)


def regression(scene: Scene) -> Fitted:
    """Fit masses and first moments by least squares, of minimum norm if not identifiable."""
    start = time.process_time()
    rows = regressors(scene.nominal, scene.train.q)
    x = rows.reshape(-1, rows.shape[-1])
    parameters = np.linalg.lstsq(x, scene.train.tau.ravel(), rcond=1e-8)[0]
    seconds = time.process_time() - start
    counts = [int(row.any(axis=0).sum()) for row in rows.transpose(1, 0, 2)]
    return Fitted(lambda q: regressors(scene.nominal, q) @ parameters, counts,
                  scene.train.n_samples, seconds)


def kernel_ridge(scene: Scene) -> Fitted:
    """Fit kernel ridge regression on rows of the regressor."""
    start = time.process_time()
    inputs = _inputs(scene, scene.train.q)
    fits = [_search().fit(x, tau) for x, tau in zip(inputs, scene.train.tau.T)]
    n = scene.train.n_samples
    return Fitted(
        lambda q: np.column_stack([fit.predict(x) for fit, x in zip(fits, _inputs(scene, q))]),
        [n] * len(fits), n, time.process_time() - start)


def _inputs(scene: Scene, q: FloatArray) -> list[FloatArray]:
    """Return each joint's inputs (M, K)."""
    rows = regressors(scene.nominal, q)
    # The torque of a joint depends on the links after it only.
    return [rows[:, n, n * _STATIC:] for n in range(q.shape[1])]


def _search() -> Any:
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.kernel_ridge import KernelRidge
    from sklearn.model_selection import GridSearchCV, KFold
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    grid = {'alpha': [1e-3, 1e-1, 10.0], 'gamma': [0.01, 0.1]}
    scaled = TransformedTargetRegressor(
        make_pipeline(StandardScaler(), KernelRidge(kernel='rbf')), transformer=StandardScaler())
    # Blocks of time: neighbouring samples are autocorrelated, which favours a narrow kernel.
    return GridSearchCV(scaled, {f'regressor__kernelridge__{key}': values
                                 for key, values in grid.items()}, cv=KFold(3))


def explicit(scene: Scene) -> Fitted:
    """Return the explicit sum over links with errors of lengths, masses and centres."""
    rng = np.random.default_rng(18)
    model = scene.nominal.model
    n = scene.nominal.n_joints
    axes = np.array([placement.rotation for placement in list(model.jointPlacements)[1:]])
    origins = np.array([placement.translation for placement in list(model.jointPlacements)[1:]])
    origins = origins + rng.uniform(-0.005, 0.005, origins.shape)
    masses = np.array([body.mass for body in list(model.inertias)[1:]])
    masses = masses * (1.0 + rng.uniform(-0.05, 0.05, n))
    centres = np.array([body.lever for body in list(model.inertias)[1:]])
    moments = masses[:, None] * (centres + rng.uniform(-0.01, 0.01, centres.shape))
    outer_masses = np.cumsum(masses[::-1])[::-1]
    moments[:-1] += outer_masses[1:, None] * origins[1:]
    for i in range(n - 1, 0, -1):
        moments[i - 1] += moments[i, 2] * axes[i][:, 2]
    chain = Chain(axes, STANDARD_GRAVITY * moments[:, :2])
    energy = expand(chain)
    counts = [len(energy.gradient(n, joint).indices) for joint in range(n)]
    return Fitted(chain.torque, counts, 0, 0.0)


def nominal(scene: Scene) -> Fitted:
    """Return Pinocchio's gravity of the nominal arm."""
    return Fitted(lambda q: arms.gravity_torque(scene.nominal, q), None, 0, 0.0)
