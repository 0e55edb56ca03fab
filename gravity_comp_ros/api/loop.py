"""
The loop as functions: fit, compare, diagnose, add effects, update.

    import gravity_comp_ros as gc
    data = gc.read(['run1.mcap', 'run2.mcap'])
    train, test = data.split(0.2)
    model = gc.fit(train)
    print(gc.compare(model, test))
    found = gc.diagnose(train, model)
    model = gc.add_effects(model, train, found.findings)
    model = gc.update(model, gc.read('tool.mcap'))
    model.save('arm.json')
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.axes import AxesOptions, known_axes
from gravity_comp_ros.api.learn import better_order, learn, LearnOptions
from gravity_comp_ros.api.model import Model
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.api.results import Diagnosis, is_found, MotionPlan
from gravity_comp_ros.api.steps import add_to_model, compare_model, update_on_axes
from gravity_comp_ros.diagnosis.diagnose import diagnose as diagnose_samples
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.diagnosis.options import DiagnosisOptions
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.estimation.refit import RefitOptions
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.planning.collision import collision_check
from gravity_comp_ros.planning.options import PlanOptions
from gravity_comp_ros.planning.plan import plan as plan_motion
from gravity_comp_ros.planning.questions import named_targets


def fit(recording: Recording, *, formulation: str | None = None,
        effects: Iterable[str] = (), urdf: str | Path | None = None,
        fixed: Mapping[str, float] | None = None, progress: Progress | None = None) -> Model:
    """
    Learn the gravity torque of an arm from slow motion.

        model = gc.fit(train, effects=['coulomb_friction', 'torque_offset:wrist'])

    With a robot description the joints of the model are in its order (`Model.joints`).

    :param formulation: `chain`, `potential`, `per_joint` or `auto`; without, the usual one
        (with a URDF that you name, the chain).
    :param effects: learned together with gravity, as `NAME` (every joint) or `NAME:JOINT`.
    :param urdf: a robot description, `none` for none; without, the one in the recordings, if they
        hold one that fits. The axes of the chain are taken from it, masses are not.
    :param fixed: where joints of the description stand that the recordings lack, rad or m.
    :param progress: called with a word and a share from 0 to 1.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises DataError: if no sample is slow, or an effect cannot be seen.
    :raises OptionError: if a formulation, effect or joint is unknown.
    """
    options = LearnOptions(formulation, AxesOptions(urdf, fixed or {}), ordered=True)
    learned = learn(recording, options, tuple(effects), progress=progress)
    result = learned.result
    for warning in filter(None, (learned.arm.axes.problem, better_order(learned))):
        result = result.with_warning(warning)
    return Model(result.model)


def compare(model: Model, recording: Recording) -> Comparison:
    """
    Compare a model with the measured torques of a recording, joint by joint.

        gc.compare(model, test).joints['elbow'].rmse       # N·m

    Errors are of the slow samples; read with `gate=None` to judge on all.

    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if the recording lacks a joint of the model.
    """
    return compare_model(model.gravity, recording)


def diagnose(recording: Recording, model: Model | None = None, *,
             effects: Sequence[str] | None = None,
             progress: Progress | None = None) -> Diagnosis:
    """
    Find which physical effect a model is missing, with its size and the evidence.

    All samples are used, fast motion included: inertia is an effect too.

    :param model: the model to judge; without, one is fitted first, as `fit` does.
    :param effects: look for these only.
    :raises DataError: if there are too few samples.
    :raises OptionError: if an effect is unknown.
    :raises ModelMismatchError: if the recording lacks a joint of the model.
    """
    for name in effects or ():
        known_effect(name)
    options = DiagnosisOptions(effects=None if effects is None else tuple(effects))
    gravity = (model or fit(recording, progress=progress)).gravity
    return Diagnosis(diagnose_samples(recording.used, gravity, options, progress))


def add_effects(model: Model, recording: Recording, effects: Iterable[str | Finding], *,
                all_samples: bool = False, progress: Progress | None = None) -> Model:
    """
    Add effects to a model and refit it as a whole; `Model.undo` takes them back.

        model = gc.add_effects(model, train, ['coulomb_friction:elbow'])

    :param effects: `NAME`, `NAME:JOINT`, or findings of a diagnosis. Of findings those are
        added that are established or likely; if none is, the model is returned as it is.
    :param all_samples: fit fast motion too (some effects do so without being asked).
    :raises DataError: if an effect is there already or cannot be seen, or samples are too few.
    :raises OptionError: if an effect or joint is unknown, or asked for twice.
    """
    wanted = [effect if isinstance(effect, str) else target(str(effect.effect), effect.joint)
              for effect in effects if isinstance(effect, str) or is_found(effect)]
    if not wanted:
        return model
    return Model(add_to_model(model.gravity, recording, wanted,
                              RefitOptions.chosen(all_samples), progress).model)


def update(model: Model, recording: Recording, *, urdf: str | Path | None = None) -> Model:
    """
    Learn what a new payload changed, from ten seconds of slow motion.

    :param recording: the arm with its new payload and nothing else.
    :param urdf: a robot description, `none` for none; without, the one in the recordings. With
        one, mass and centre of mass are in `report.payload`; the axes that the model was fitted
        with serve as well.
    :raises FitError: if there are too few slow samples.
    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if the recording lacks a joint, or the model has no energy.
    """
    axes = known_axes(recording.reports, model.joints, AxesOptions(urdf), model=model.gravity)
    return Model(update_on_axes(model.gravity, recording, axes)[0].model)


def plan(model: Model, recording: Recording, effects: Iterable[str] | None = None, *,
         urdf: str | Path | None = None, options: PlanOptions = PlanOptions(),
         progress: Progress | None = None) -> MotionPlan:
    """
    Plan the motion that settles what a recording leaves open.

        gc.plan(model, train, ['coulomb_friction:elbow']).save('motion.yaml')

    :param effects: `NAME`, `NAME:JOINT`, or `gravity` for the poses where the model is unsure;
        without, what a diagnosis cannot settle.
    :param urdf: a robot description, by whose collision geometry no links hit each other.
    :param options: duration, limits and reach of the motion.
    :raises DataError: if there is nothing to settle, or no motion that would.
    :raises OptionError: if an effect or joint is unknown, or a limit makes no sense.
    """
    targets = None if effects is None else named_targets(effects, model.joints)
    samples = recording.used.joints(model.joints)
    check, links = collision_check(None if urdf is None else Path(urdf), model.joints, samples.q)
    found = plan_motion(samples, model.gravity, targets, options, progress=progress,
                        obstacles=check)
    return MotionPlan(replace(found, notes=(*found.notes, links)))
