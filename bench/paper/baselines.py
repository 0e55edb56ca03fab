"""
Other methods: regression with known kinematics, kernels, an explicit formula, a nominal URDF.

- regression: with known kinematics the torque is linear in the masses and first moments of the
  links (Yu 2022, Eq. (19)); least squares on Pinocchio's regressor.
- kernel ridge and SVR: one for each joint, on that joint's row of the same regressor (physical) or
  on the joint angles (raw). Hyper-parameters by cross-validation over blocks of time; the search
  is included in the time.
- EFD: the explicit formula from D-H parameters, with errors of lengths up to 5 mm, of masses up to
  5 % and of centres up to 1 cm, as from a data sheet and a scale.
- nominal: Pinocchio with the URDF, without a payload.
"""

from __future__ import annotations

import time
from typing import Any

from bench.paper.methods import Fitted, Method
from bench.paper.scenes import FloatArray, Scene
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.expansion import expand
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


def kernel(kind: str, physical: bool, quick: bool = False) -> Method:
    """Return kernel ridge ('krr') or support vector regression ('svr')."""
    def method(scene: Scene) -> Fitted:
        start = time.process_time()
        inputs = _inputs(scene, scene.train.q, physical)
        fits = [_search(kind, quick).fit(x, tau) for x, tau in zip(inputs, scene.train.tau.T)]
        seconds = time.process_time() - start

        def predict(q: FloatArray) -> FloatArray:
            return np.column_stack([search.predict(x) for search, x in zip(
                fits, _inputs(scene, q, physical))])
        counts = [_size(search, scene.train.n_samples) for search in fits]
        return Fitted(predict, counts, scene.train.n_samples, seconds)
    return method


def _inputs(scene: Scene, q: FloatArray, physical: bool) -> list[FloatArray]:
    """Return each joint's inputs (M, K)."""
    if not physical:
        return [q] * q.shape[1]
    rows = regressors(scene.nominal, q)
    # The torque of a joint depends on the links after it only.
    return [rows[:, n, n * _STATIC:] for n in range(q.shape[1])]


def _search(kind: str, quick: bool) -> Any:
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.kernel_ridge import KernelRidge
    from sklearn.model_selection import GridSearchCV, KFold
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import SVR
    gammas = [0.1] if quick else [0.01, 0.1]
    if kind == 'krr':
        name, model = 'kernelridge', KernelRidge(kernel='rbf')
        grid = {'alpha': [0.1] if quick else [1e-3, 1e-1, 10.0], 'gamma': gammas}
    else:
        name, model = 'svr', SVR(epsilon=0.01)
        grid = {'C': [10.0] if quick else [1.0, 10.0], 'gamma': gammas}
    scaled = TransformedTargetRegressor(make_pipeline(StandardScaler(), model),
                                        transformer=StandardScaler())
    # Blocks of time: neighbouring samples are autocorrelated, which favours a narrow kernel.
    return GridSearchCV(scaled, {f'regressor__{name}__{key}': values
                                 for key, values in grid.items()}, cv=KFold(3))


def _size(search: Any, n_samples: int) -> int:
    last = search.best_estimator_.regressor_[-1]
    return int(len(last.support_)) if hasattr(last, 'support_') else n_samples


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
