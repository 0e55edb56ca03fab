"""
Energy change by an earlier payload, as the direction of later payload changes.

For arms of unknown link lengths. A body of mass m on the last link adds m times a fixed offset to
the moment of every link before it (Yu 2022, Eq. (19)), and its own first moment to those of the
last link. The inner links' change by a payload is therefore proportional to its mass. The change
is stored as an energy, which does not depend on the placement of a chain's frames, and is
converted to moments of the chain that is to change.
"""

from __future__ import annotations

from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.sparse.dictionary import Expansion, torque_of
import numpy as np


def payload_path(before: GravityModel, after: GravityModel) -> Expansion | None:
    """
    Return the energy in J added by the larger of this payload and those before.

    :return: None if no payload has been identified yet.
    """
    if before.energy is None or after.energy is None:
        return before.payload_path
    change = _difference(before.energy, after.energy)
    minimum = OPTIONS.min_path * float(before.noise_with_nuisance.max())
    if before.payload_path is not None:
        minimum = max(minimum, _rms_torque(before.payload_path, before))
    return change if _rms_torque(change, before) > minimum else before.payload_path


def path_moments(path: Expansion, chain: Chain, box: FloatArray) -> FloatArray:
    """
    Return the change of a chain's moments (2N,) in N·m whose torque is nearest to an energy's.

    :param box: lower and upper ends (2, N) in rad of the poses at which the torques are compared.
    """
    q = random_poses(chain.n_joints, *box)
    columns = ForwardKinematics(chain.axes, q).moment_columns()
    rows = columns.reshape(len(columns), -1).T
    return np.asarray(lstsq(rows, _torque(path, q).T.ravel(), rcond=1e-6))


def _rms_torque(path: Expansion, model: GravityModel) -> float:
    """Return the RMS torque of an energy within the trained range, of the worst joint, N·m."""
    q = random_poses(model.n_joints, model.coverage.q_min, model.coverage.q_max)
    return float(np.sqrt((_torque(path, q) ** 2).mean(axis=0)).max())


def _torque(energy: Expansion, q: FloatArray) -> FloatArray:
    n = q.shape[1]
    return torque_of([energy.gradient(n, joint) for joint in range(n)], q)


def _difference(before: Expansion, after: Expansion) -> Expansion:
    indices = np.union1d(before.indices, after.indices)
    weights = np.zeros(len(indices))
    weights[np.searchsorted(indices, after.indices)] += after.weights
    weights[np.searchsorted(indices, before.indices)] -= before.weights
    return Expansion(indices, weights)
