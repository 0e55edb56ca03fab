"""Check of a description against a recording: faults, moments, and what cannot be checked."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.description.links import DescribedArm, frame_parameters, on_frame
from gravity_comp_ros.description_check.faults import (
    AXIS_REVERSED, AXIS_TURNED, CheckOptions, Fault, FaultyArm, MOUNT, possible_faults, ZERO)
from gravity_comp_ros.description_check.search import corrected, FaultEvidence, FaultFit, search
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.rigid_body import inverse_dynamics
from gravity_comp_ros.models.noise import of_second_differences
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np


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
                      options: CheckOptions = CheckOptions()) -> DescriptionCheck:
    """
    Return the faults of a description that a recording of slow motion shows.

    :param samples: of the joints of the arm, with speeds.
    :raises DataError: if there are too few samples, or no link of the arm has a mass.
    """
    joints, inertials = arm.geometry.joints, arm.inertials()
    samples = samples.joints(joints)
    if samples.n_samples < FactOptions().min_slow_samples:
        raise DataError(f'{samples.n_samples} slow samples are too few to check a description; '
                        f'at least {FactOptions().min_slow_samples} are needed')
    links = {name: (arm.place(name).joint, on_frame(arm, name, inertial))
             for name, inertial in inertials.items()}
    state = FaultyArm.described(arm.geometry.rotations, arm.geometry.origins,
                                frame_parameters(arm, inertials)[:, :4])
    faults = possible_faults(state, joints, {
        name: (frame, own[:4]) for name, (frame, own) in links.items() if own[0] > 0.0}, options)
    fits: list[FaultFit] = []
    noise = of_second_differences(samples.tau, np.ones(samples.n_samples - 2, dtype=bool))
    evidence = _evidence(samples, arm.geometry, state, noise, options)
    for _ in range(EngineOptions().passes):
        fits, following = search(evidence, state, faults)
        noise = np.minimum(noise, _rms(evidence, corrected(
            state, [*fits, *([] if fits else [following])])))
        earlier, evidence = evidence, _evidence(samples, arm.geometry, corrected(state, fits),
                                                noise, options)
        # The residual of a wrong description looks like friction, which hides smaller faults.
        if (options.smaller * evidence.weight < earlier.weight).all():
            break
    final = corrected(state, fits)
    return DescriptionCheck(joints, tuple(fits), _rms(evidence, state), _rms(evidence, final),
                            np.sqrt((samples.tau ** 2).mean(axis=0)),
                            _unchecked(evidence, final, faults))


def _rms(evidence: FaultEvidence, arm: FaultyArm) -> FloatArray:
    """Return the RMS residual (N,) of an arm, offset and friction fitted, N·m."""
    residual = evidence.residual(arm).reshape(len(evidence.q), -1) / evidence.weight
    return np.asarray(np.sqrt((residual ** 2).mean(axis=0)))


def _evidence(samples: JointSamples, geometry: Geometry, arm: FaultyArm, noise: FloatArray,
              options: CheckOptions) -> FaultEvidence:
    """Return the evidence of gravity, with the dynamic torque of an arm subtracted."""
    q, qd = samples.q, samples.qd
    qdd = accelerations(samples)
    turned = replace(geometry, rotations=arm.rotations, origins=arm.origins)
    torque = inverse_dynamics(turned, q[:, arm.order], qd[:, arm.order], qdd[:, arm.order],
                              np.column_stack([arm.bodies, geometry.inertials[:, 4:]]).ravel())
    samples = replace(samples, tau=samples.tau - arm.recorded(torque))
    return FaultEvidence(samples, noise, arm, options)


def _unchecked(evidence: FaultEvidence, arm: FaultyArm, faults: list[Fault]
               ) -> dict[str, tuple[str, ...]]:
    """Return the joints by kind of fault for which it would not show."""
    result: dict[str, tuple[str, ...]] = {}
    cost = 0.5 * (evidence.residual(arm) ** 2).sum()
    for fault in faults:
        if fault.kind == AXIS_REVERSED:
            reversed_arm = fault.change(arm, np.zeros(0))
            is_visible = bool(0.5 * (evidence.residual(reversed_arm) ** 2).sum() - cost
                              > EngineOptions().min_gain)
        elif fault.kind in (ZERO, AXIS_TURNED, MOUNT):
            start = fault.starts[0]
            _, covariance, _ = evidence.fitted(arm, [fault], start, start)
            std = np.sqrt(np.linalg.eigvalsh(covariance)[-1])
            is_visible = bool(std < evidence.options.unchecked)
        else:
            continue
        if not is_visible:
            result[fault.kind] = (*result.get(fault.kind, ()), *fault.subjects)
    return result
