"""Calibration loop as functions: fit, compare, diagnose, add effects, update, plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.axes import ArmOptions, known_arm
from gravity_comp_ros.api.model import Model
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.api.steps import (
    add_to_model, compare_model, diagnose_recording, learn, order_by_torques, update_model)
from gravity_comp_ros.description.joint_order import AS_RECORDED, joint_order
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.planning.collision import arm_limits
from gravity_comp_ros.planning.expected import MotionPlan
from gravity_comp_ros.planning.plan import plan as plan_motion
from gravity_comp_ros.planning.workspace import PlanOptions


def fit(recording: Recording, *, formulation: str | None = None,
        effects: Iterable[str] = (), urdf: str | Path | None = None,
        fixed: Mapping[str, float] | None = None, progress: Progress | None = None) -> Model:
    """
    Fit the gravity torque of an arm to slow motion.

        model = gc.fit(train, effects=['coulomb_friction', 'torque_offset:wrist'])
        print(model)

    With a robot description the joints of the model are in its order (`Model.joints`).

    :param formulation: `chain` (serial arm), `potential` (one sparse energy), `per_joint` (one
        sparse sum per joint) or `auto`. The default is `auto`; with `urdf` it is `chain`.
    :param effects: effects fitted jointly with gravity, on every joint (`NAME`) or on one
        (`NAME:JOINT`).
    :param urdf: a robot description file, or `none`. The default is the description in the
        recordings, if it matches. The model takes the joint axes from it. Its masses are
        a prior of the inertias alone: gravity is learned from the torque.
    :param fixed: positions, in rad or m, of description joints that were not recorded.
    :param progress: called with the name of the step and its completed fraction, 0 to 1.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises DataError: if no sample is slow, or an effect is not identifiable from the samples.
    :raises OptionError: if a formulation, effect or joint is unknown.
    """
    options = ArmOptions(formulation, urdf, fixed or {}, ordered=True)
    learned = learn(recording, options, tuple(effects), progress=progress)
    result, order = learned.result, None
    if recording.reports and learned.arm.geometry is None \
            and joint_order(recording.joints).source == AS_RECORDED:
        order = order_by_torques(learned.recording, result)
    if order is not None:
        result = result.with_warning(
            f'the joint order {", ".join(order.joints)} explains the torques much better: read '
            f'the recording with `joints` in the order of the arm')
    return Model(result.model)


def compare(model: Model, recording: Recording) -> Comparison:
    """
    Compute the error of each joint: measured torque minus model, in N·m.

        gc.compare(model, test).joints['elbow'].rmse       # N·m

    The errors cover the slow samples; a recording read with `gate=None` is compared as a whole.

    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if a joint of the model is missing in the recording.
    """
    return compare_model(model.gravity, recording)


def diagnose(recording: Recording, model: Model | None = None, *,
             effects: Sequence[str] | None = None,
             progress: Progress | None = None) -> Diagnosis:
    """
    Identify the physical effects that a model does not include.

        for finding in gc.diagnose(train, model).found:
            print(finding.effect, finding.joint, finding.verdict, finding.coefficients)

    All samples are used, including fast motion, because inertia is one of the effects.

    :param model: the model to diagnose; by default one of gravity alone.
    :param effects: names of the effects to test; by default all that are registered.
    :param progress: called with the name of the step and its completed fraction, 0 to 1.
    :raises DataError: if there are too few samples.
    :raises OptionError: if an effect is unknown.
    :raises ModelMismatchError: if a joint of the model is missing in the recording.
    """
    return diagnose_recording(recording, model.gravity if model else None, effects,
                              ArmOptions(ordered=True), progress).diagnosis


def add_effects(model: Model, recording: Recording, effects: Iterable[str | Finding], *,
                progress: Progress | None = None) -> Model:
    """
    Add effects to a model and refit gravity and effects jointly, to the samples of `fit`.

        model = gc.add_effects(model, train, ['coulomb_friction:elbow'])
        print(model.held_out['elbow'])    # RMSE before and after, N·m

    `Model.undo` removes the effects again.

    :param effects: effects on every joint (`NAME`), on one joint
        (`NAME:JOINT`), or findings of a diagnosis. Established and likely effects are added, and
        ambiguous ones with their alternatives; without any, the model is returned unchanged.
    :param progress: called with the name of the step and its completed fraction, 0 to 1.
    :raises DataError: if an effect is in the model already or is not identifiable, or if there
        are too few samples.
    :raises OptionError: if an effect or joint is unknown, or named twice.
    """
    targets = dict.fromkeys(name for effect in effects for name in (
        (effect,) if isinstance(effect, str) else effect.to_add))
    if not targets:
        return model
    return Model(add_to_model(model.gravity, recording, list(targets), progress).model)


def update(model: Model, recording: Recording, *, urdf: str | Path | None = None) -> Model:
    """
    Update the gravity model after a payload change, from about ten seconds of slow motion.

        model = gc.update(model, gc.read('tool.mcap'))
        print(model.payload)    # {'mass': kg, 'x': m, ...}, with known axes

    The effects of the model stay unchanged. With known axes the change is identified as a mass
    and a centre of mass.

    :param recording: motion with the new payload only.
    :param urdf: a robot description file, or `none`. The default is the description in the
        recordings, else the axes that the model was fitted with.
    :raises FitError: if there are too few slow samples.
    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if a joint of the model is missing in the recording, or the model
        is of the formulation `per_joint`.
    """
    arm = known_arm(recording, ArmOptions(urdf=urdf), model.gravity)
    return Model(update_model(model.gravity, recording, arm)[0].model)


def plan(model: Model, recording: Recording, effects: Iterable[str] | None = None, *,
         urdf: str | Path | None = None, options: PlanOptions = PlanOptions(),
         progress: Progress | None = None) -> MotionPlan:
    """
    Plan a motion that excites effects which a recording does not identify.

        gc.plan(model, train, ['coulomb_friction:elbow']).save('motion.yaml')

    :param effects: effects on every joint (`NAME`), on one joint
        (`NAME:JOINT`), or `gravity` for poses with a large standard deviation of the gravity
        torque. By default, the effects that a diagnosis does not resolve.
    :param urdf: a robot description file, whose collision geometry is checked for self-collision.
        The default is the description in the recordings.
    :param options: duration, limits and position range of the motion.
    :param progress: called with the name of the step and its completed fraction, 0 to 1.
    :raises DataError: if all effects are resolved, or no motion resolves one.
    :raises OptionError: if an effect or joint is unknown, or a limit is invalid.
    """
    samples = recording.used.joints(model.joints)
    limits = arm_limits(urdf, [report.path for report in recording.reports], model.joints,
                        samples.q)
    motion = plan_motion(samples, model.gravity, None if effects is None else list(effects),
                         options, progress=progress, obstacles=limits.check)
    return replace(motion, notes=(*motion.notes, limits.note))
