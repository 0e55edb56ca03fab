"""
An arm with given axes and first moments: masses along its links.

Gravity shows first moments alone. Of all arms that have them, one with masses at the ends and in
the middle of each link, none negative, is physical, and its inertias are of the right size.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.rigid_body import PARAMETERS, regressor
from gravity_comp_ros.models.least_squares import lstsq, non_negative
import numpy as np

# Masses lie about the middle line of a link, at this share of the mean length of it and of the one
# before.
_ASIDE = 0.5
# m: the least length that counts.
_SHORT = 0.05
# Weight of a mass of 1 kg against a moment that differs by the largest of all: masses that the
# moments leave open are spread evenly.
_EVEN = 0.03
# Share of the mass of the arm that a link has at least where its first moment needs a mass.
_LEAST_MASS = 0.1
# m: a moment that 1 kg anywhere changes by less than this is none of gravity's.
_UNSEEN = 1e-6
_DIAGONAL = [PARAMETERS.index(name) for name in ('Ixx', 'Iyy', 'Izz')]
# Poses at which moments of masses, and inertias, are computed.
_POSES = 40


def nominal_parameters(geometry: Geometry, moments: FloatArray) -> FloatArray:
    """
    Return inertial parameters (10 N,) of an arm with given first moments (`rigid_body`).

    :param moments: (N, 2) in kg·m about the axes, what lies beyond a link counted as in `Chain`.
    """
    parameters, masses, missing = _nearest(geometry, moments)
    found = np.asarray(masses @ parameters)
    # Masses that are not negative need not reach every moment: the rest is put where it is, with
    # the inertia that keeps kinetic energy positive, h^2 / m.
    each = found.reshape(-1, len(PARAMETERS))
    mass = np.maximum(each[:, 0], _LEAST_MASS * max(float(each[:, 0].sum()), 1e-9))
    each[:, 1:3] += missing
    each[:, _DIAGONAL] += ((missing ** 2).sum(axis=1) / mass)[:, None]
    return found


def out_of_reach(geometry: Geometry, moments: FloatArray) -> float:
    """
    Return the share of the moments (N, 2) that masses which are not negative cannot make.

    It is large where the arm hangs upside down.
    """
    missing = _nearest(geometry, moments)[2]
    return float(np.linalg.norm(missing) / max(float(np.linalg.norm(moments)), 1e-12))


def _nearest(geometry: Geometry, moments: FloatArray
             ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return parameters (P, 10 N) of 1 kg each, masses (P,), and the moments (N, 2) they miss."""
    parameters = np.concatenate([_of_points(places, link, geometry.n_joints)
                                 for link, places in enumerate(_points(geometry))])
    weighed = _moments_of(geometry, parameters)
    size = max(float(np.abs(moments).max()), 1e-9)
    a = np.concatenate([weighed / size, _EVEN * np.eye(len(parameters))], axis=0)
    b = np.concatenate([moments.ravel() / size, np.zeros(len(parameters))])
    masses = non_negative(a, b)
    missing = moments - (weighed @ masses).reshape(-1, 2)
    # A vertical axis leaves the first moment of its link without gravity, and without a say here.
    missing[np.abs(weighed).max(axis=1).reshape(-1, 2) < _UNSEEN] = 0.0
    return parameters, masses, missing


def mean_inertia(geometry: Geometry, parameters: FloatArray) -> FloatArray:
    """Return the inertia (N,) in kg·m^2 about each joint, the mean over poses drawn at random."""
    n = geometry.n_joints
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, n))
    found = np.empty(n)
    for joint in range(n):
        unit = np.zeros_like(q)
        unit[:, joint] = 1.0
        torque = regressor(geometry, q, np.zeros_like(q), unit) @ parameters
        found[joint] = torque[:, joint].mean()
    return found


def _points(geometry: Geometry) -> list[FloatArray]:
    """Return where masses of each link may be, (P, 3) in m in its own frame."""
    ends = [*geometry.origins[1:], np.zeros(3)]
    lengths = np.linalg.norm(ends, axis=1)
    before = np.linalg.norm(geometry.origins, axis=1)
    found = []
    for end, length, last in zip(ends, lengths, before):
        aside = _ASIDE * max(0.5 * float(length + last), _SHORT)
        around = np.concatenate([np.zeros((1, 3)), aside * np.eye(3), -aside * np.eye(3)])
        shares = (0.0, 0.5, 1.0) if length > _SHORT else (0.0,)
        found.append(np.concatenate([share * end + around for share in shares]))
    return found


def _of_points(places: FloatArray, link: int, n: int) -> FloatArray:
    """Return the parameters (P, 10 N) of 1 kg at each place of a link."""
    x, y, z = places.T
    one = np.stack([np.ones(len(places)), x, y, z, y * y + z * z, -x * y, -x * z, x * x + z * z,
                    -y * z, x * x + y * y], axis=1)
    found = np.zeros((len(places), len(PARAMETERS) * n))
    found[:, len(PARAMETERS) * link:len(PARAMETERS) * (link + 1)] = one
    return found


def _moments_of(geometry: Geometry, parameters: FloatArray) -> FloatArray:
    """Return the first moments (2 N, P) in kg·m of parameters (P, 10 N), from their gravity."""
    n = geometry.n_joints
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, n))
    zero = np.zeros_like(q)
    torque = regressor(geometry, q, zero, zero, 1.0) @ parameters.T
    columns = ForwardKinematics(geometry.rotations, q).moment_columns()
    flat = columns.transpose(2, 1, 0).reshape(-1, 2 * n)
    return np.asarray(lstsq(flat, torque.reshape(len(flat), -1), rcond=1e-9))
