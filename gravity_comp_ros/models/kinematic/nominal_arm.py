"""
A nominal arm with given axes and first moments: described links, and point masses along them.

Gravity determines first moments only. Among all arms with the same moments, one with non-negative
masses at the ends and in the middle of each link is physical, and its inertias have the right
order of magnitude. The links of a description have better ones: each has a factor that is not
negative, and the point masses are added to them.
"""

from __future__ import annotations

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.rigid_body import PARAMETERS
import numpy as np

# Distance of the masses from a link's centre line, as a share of the mean length of the link and
# the one before.
_RADIUS = 0.5
# Minimum length of a link, in m.
_MIN_LENGTH = 0.05
# Regularisation: weight of 1 kg, more or less than described, against a moment error of the size
# of the largest moment. It distributes undetermined masses evenly.
_REGULARISATION = 0.03


def nominal_parameters(geometry: Geometry, moments: FloatArray) -> FloatArray:
    """
    Return inertial parameters (10 N,) of the arm with the nearest gravity torque (`rigid_body`).

    :param moments: (N, 2) in kg·m about the axes, each including all links beyond (`Chain`).
    """
    q = random_poses(len(moments))
    columns = ForwardKinematics(geometry.rotations, q).moment_columns()
    flat = columns.transpose(2, 1, 0).reshape(-1, 2 * len(moments))
    parameters, masses, _ = _nearest(geometry, moments, np.linalg.qr(flat)[1])
    return np.asarray(masses @ parameters)


def unreachable_share(geometry: Geometry, moments: FloatArray, weights: FloatArray) -> float:
    """
    Return the share of the moments (N, 2) out of reach of non-negative masses.

    :param weights: of the moments, (2 N, 2 N): 0 in directions that are not identifiable.
    """
    missing = _nearest(geometry, moments, weights)[2].ravel()
    return float(np.linalg.norm(weights @ missing)
                 / max(float(np.linalg.norm(weights @ moments.ravel())), 1e-12))


def _nearest(geometry: Geometry, moments: FloatArray, weights: FloatArray | None = None
             ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return parameters (P, 10 N) of 1 kg each, masses (P,), and unreached moments (N, 2).

    :param weights: of the moments, (2 N, 2 N); None for equal weights.
    """
    described, masses = _described(geometry)
    parameters = np.concatenate([described, *(
        _of_points(places, link, geometry.n_joints)
        for link, places in enumerate(_points(geometry)))])
    expected = np.concatenate([masses, np.zeros(len(parameters) - len(masses))])
    per_mass = geometry.moments() @ parameters.T / STANDARD_GRAVITY
    weights = np.eye(len(per_mass)) if weights is None else weights
    target = weights @ moments.ravel()
    size = max(float(np.abs(target).max()), 1e-9)
    a = np.concatenate([weights @ per_mass / size, _REGULARISATION * np.eye(len(parameters))])
    b = np.concatenate([target / size, _REGULARISATION * expected])
    from scipy.optimize import nnls  # imported here because it takes long
    masses, _ = nnls(a, b)
    missing = moments - (per_mass @ masses).reshape(-1, 2)
    # Moments about a vertical axis have no gravity torque and are not identifiable.
    missing[~per_mass.any(axis=1).reshape(-1, 2)] = 0.0
    return parameters, masses, missing


def _described(geometry: Geometry) -> tuple[FloatArray, FloatArray]:
    """Return the parameters (L, 10 N) per kg of the described links, and their masses (L,)."""
    masses = geometry.inertials[:, 0]
    links = np.flatnonzero(masses > 0.0)
    parameters = np.zeros((len(links), *geometry.inertials.shape))
    parameters[np.arange(len(links)), links] = geometry.inertials[links] / masses[links, None]
    return parameters.reshape(len(links), geometry.inertials.size), masses[links]


def _points(geometry: Geometry) -> list[FloatArray]:
    """Return the candidate points of masses of each link, (P, 3) in m in its own frame."""
    ends = [*geometry.origins[1:], np.zeros(3)]
    lengths = np.linalg.norm(ends, axis=1)
    before = np.linalg.norm(geometry.origins, axis=1)
    points = []
    for end, length, previous in zip(ends, lengths, before):
        radius = _RADIUS * max(0.5 * float(length + previous), _MIN_LENGTH)
        around = np.concatenate([np.zeros((1, 3)), radius * np.eye(3), -radius * np.eye(3)])
        shares = (0.0, 0.5, 1.0) if length > _MIN_LENGTH else (0.0,)
        points.append(np.concatenate([share * end + around for share in shares]))
    return points


def _of_points(places: FloatArray, link: int, n: int) -> FloatArray:
    """Return the parameters (P, 10 N) of 1 kg at each point (P, 3) of a link."""
    x, y, z = places.T
    own = np.stack([np.ones(len(places)), x, y, z, y * y + z * z, -x * y, -x * z, x * x + z * z,
                    -y * z, x * x + y * y], axis=1)
    parameters = np.zeros((len(places), len(PARAMETERS) * n))
    parameters[:, len(PARAMETERS) * link:len(PARAMETERS) * (link + 1)] = own
    return parameters
