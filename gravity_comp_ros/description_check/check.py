"""Check of a description against a recording: faults, moments, and what cannot be checked."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.acceleration import accelerations
from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.description.inertials import Inertial
from gravity_comp_ros.description.link_places import DescribedArm
from gravity_comp_ros.description_check.arm_state import ArmState
from gravity_comp_ros.description_check.faults import (
    AXIS_TURNED, Fault, MOUNT, possible_faults, ZERO)
from gravity_comp_ros.description_check.search import (
    changed, CheckOptions, Evidence, FaultFit, search)
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.rigid_body import PARAMETERS, regressor
import numpy as np

_MIN_SAMPLES = 50
# Standard deviation in rad beyond which an angle counts as not checked.
_UNCHECKED = 0.05


@dataclass(frozen=True, eq=False)
class DescriptionCheck:
    """
    The result of a check.

    `faults` are the worst first. `before` and `after` (N,) are the RMS residual in N·m with the
    description as it is and without the faults, offset and friction fitted. `unchecked` are faults
    that this recording does not show, by kind.
    """

    joints: tuple[str, ...]
    faults: tuple[FaultFit, ...]
    before: FloatArray
    after: FloatArray
    torque: FloatArray
    unchecked: dict[str, tuple[str, ...]]


def check_description(samples: JointSamples, arm: DescribedArm,
                      inertials: dict[str, Inertial],
                      options: CheckOptions = CheckOptions()) -> DescriptionCheck:
    """
    Return the faults of a description that a recording of slow motion shows.

    :param samples: of the joints of the arm, with speeds.
    :param inertials: of the links that the arm carries.
    :raises DataError: if there are too few samples.
    """
    joints = arm.geometry.joints
    samples = samples.joints(joints)
    if samples.n_samples < _MIN_SAMPLES:
        raise DataError(f'{samples.n_samples} slow samples are too few to check a description; '
                        f'at least {_MIN_SAMPLES} are needed')
    parameters, links = _parameters(arm, inertials)
    state = ArmState.described(arm.geometry.rotations, arm.geometry.origins, parameters[:, :4])
    faults = possible_faults(state, joints, links)
    evidence = _evidence(samples, arm.geometry, state, parameters, options)
    fits = search(evidence, state, faults)
    if fits:
        # The dynamic torque of the corrected arm.
        corrected = changed(state, [fit.fault for fit in fits],
                            np.concatenate([fit.parameters for fit in fits]))
        evidence = _evidence(samples, arm.geometry, corrected, parameters, options)
        fits = search(evidence, state, faults)
    final = changed(state, [fit.fault for fit in fits],
                    np.concatenate([np.zeros(0), *(fit.parameters for fit in fits)]))
    scale = 1.0 / evidence.weight
    rms = [np.sqrt((evidence.residual(one).reshape(-1, len(joints)) ** 2).mean(axis=0)) * scale
           for one in (state, final)]
    return DescriptionCheck(joints, tuple(fits), rms[0], rms[1],
                            np.sqrt((samples.tau ** 2).mean(axis=0)),
                            _unchecked(evidence, final, faults))


def _parameters(arm: DescribedArm, inertials: dict[str, Inertial]
                ) -> tuple[FloatArray, dict[str, tuple[int, FloatArray]]]:
    """Return the inertial parameters (N, 10) of the frames, and the bodies of the links."""
    parameters = np.zeros((arm.geometry.n_joints, len(PARAMETERS)))
    links = {}
    for name, inertial in inertials.items():
        place = arm.place(name)
        moved = replace(inertial, centre=place.origin + place.rotation @ inertial.centre,
                        inertia=place.rotation @ inertial.inertia @ place.rotation.T)
        own = moved.about_origin()
        parameters[place.joint] += own
        if inertial.mass > 0.0:
            links[name] = place.joint, own[:4]
    return parameters, links


def _evidence(samples: JointSamples, geometry: Geometry, arm: ArmState, parameters: FloatArray,
              options: CheckOptions) -> Evidence:
    """Return the evidence of gravity, with the dynamic torque of an arm subtracted."""
    q, qd = samples.q, samples.qd
    qdd = accelerations(samples)
    turned = replace(geometry, rotations=arm.rotations, origins=arm.origins)
    columns = regressor(turned, arm.angles(q), arm.signs * qd[:, arm.order],
                        arm.signs * qdd[:, arm.order])
    dynamic = arm.recorded(columns @ np.column_stack([arm.bodies, parameters[:, 4:]]).ravel())
    tau = samples.tau - dynamic
    interval = np.median(np.diff(samples.t)) if samples.n_samples > 1 else options.correlation
    per_error = max(1.0, options.correlation / max(float(interval), 1e-6))
    return Evidence(q, qd, tau, _noise(tau), per_error, options)


def _noise(tau: FloatArray) -> FloatArray:
    """Return the white noise (N,) of torques from their second differences, N·m."""
    differences = np.diff(tau, n=2, axis=0)
    return np.asarray(np.median(np.abs(differences), axis=0) / 0.6745 / np.sqrt(6.0))


def _unchecked(evidence: Evidence, arm: ArmState, faults: list[Fault]
               ) -> dict[str, tuple[str, ...]]:
    """Return the joints by kind of angle whose fault would not show."""
    result: dict[str, tuple[str, ...]] = {}
    for fault in faults:
        if fault.kind not in (ZERO, AXIS_TURNED, MOUNT):
            continue
        start = fault.starts[0]
        _, covariance, _ = evidence.fitted(arm, [fault], start, start)
        if np.sqrt(np.linalg.eigvalsh(covariance)[-1]) > _UNCHECKED:
            result[fault.kind] = (*result.get(fault.kind, ()), *fault.subjects)
    return result


def total_mass(arm: ArmState) -> float:
    """Return the mass in kg that the first joint carries."""
    return float(arm.bodies[:, 0].sum())


def moment_of(arm: ArmState) -> FloatArray:
    """Return the first moments (N, 2) of a chain in N·m / g, kg m."""
    return arm.chain().moments / STANDARD_GRAVITY
