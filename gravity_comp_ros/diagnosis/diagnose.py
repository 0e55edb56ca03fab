"""Learn which physical effect a gravity model is missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.diagnosis import (
    alternative_models, nonparametric as unknown_torque, structure_tests)
from gravity_comp_ros.diagnosis.base import Base, choose_base, refined
from gravity_comp_ros.diagnosis.candidates import build, Candidate, Columns
from gravity_comp_ros.diagnosis.evidence import joint_gram, JointGram
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.diagnosis.nuisance import nuisance
from gravity_comp_ros.diagnosis.selection import Selection, SelectionOptions
from gravity_comp_ros.diagnosis.verdict import Judge
from gravity_comp_ros.effects.effect import Effect, Motion
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.evaluation.blocks import Blocks, cut
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

Progress = Callable[[str, float], None]

_MOST_SAMPLES = 25000


@dataclass(frozen=True)
class DiagnosisOptions:
    """How to diagnose: when an effect counts, and which effects to look for (None: all)."""

    selection: SelectionOptions = SelectionOptions()
    effects: tuple[str, ...] | None = None


def diagnose(samples: JointSamples, model: GravityModel | None = None,
             options: DiagnosisOptions = DiagnosisOptions(),
             progress: Progress | None = None) -> Diagnosis:
    """
    Rank the effects that would explain what the gravity model leaves.

    :param samples: one or several runs, fast motion included: inertia is an effect too.
    :param model: the gravity model to judge beside, with the effects that it has; None fits
        one.
    :raises DataError: if there are too few samples.
    :raises ModelMismatchError: if the samples lack a joint of the model.
    """
    tell = progress or (lambda word, share: None)
    if model is not None:
        samples = samples.joints(model.joints)
    span = np.ptp(samples.tau, axis=0) if len(samples) else np.zeros(samples.n_joints)
    if model is not None:
        # What the model has already is not missing; its size may change (`Base.given`).
        samples = replace(samples, tau=samples.tau - effect_torque(model, samples))
    samples = samples.select(
        np.arange(samples.n_samples) % -(-max(samples.n_samples, 1) // _MOST_SAMPLES) == 0)
    tell('gravity model', 0.0)
    base = choose_base(samples, model)
    motion = base.motion
    tell('columns', 0.2)
    columns = build(motion, base.columns, _effects(options))
    known = all_effects()
    columns.untestable = {key: reason for key, reason in columns.untestable.items()
                          if key[0] in known}
    tell('selection', 0.5)
    selection = _select(base, columns, options.selection)
    better = refined(base, selection.effect_torque()) if selection.chosen else None
    if better is not None:
        tell('selection', 0.7)
        del selection  # half a gigabyte of products
        columns = columns.with_base(better.columns)
        selection = _select(base, columns, options.selection)
    tell('verdicts', 0.8)
    diagnosis = Judge(selection, motion, span).diagnosis()
    tests = columns.of_family(structure_tests.FAMILY)
    laws = structure_tests.check_laws(selection, tests, samples.names)
    diagnosis = replace(diagnosis, laws=laws)
    tell('verdicts', 1.0)
    return diagnosis


def _effects(options: DiagnosisOptions) -> Mapping[str, Effect]:
    known = all_effects()
    if options.effects is not None:
        known = {name: known[name] for name in options.effects}
    return {**known, unknown_torque.NAME: unknown_torque.UNKNOWN,
            **{law.name: law for law in structure_tests.LAWS},
            **alternative_models.other_laws(known)}


def _select(base: Base, columns: Columns, options: SelectionOptions) -> Selection:
    """Return the finished selection among the effects that have names."""
    motion = base.motion
    loose = [*columns.of_family(unknown_torque.FAMILY), *columns.of_family(structure_tests.FAMILY)]
    nameless = {c.key for c in (*loose, *columns.of_family(alternative_models.FAMILY))}
    effects = [c for c in columns.candidates if c.key not in base.given | nameless]
    blocks, grams = _evidence(motion, columns, loose)

    def implausible(candidate: Candidate, values: FloatArray) -> str | None:
        return candidate.effect.implausible(values, candidate.setting, motion,
                                            candidate.joint or 0)

    selection = Selection(grams, columns, effects, blocks, implausible, options, base.given)
    selection.run()
    return selection


def _evidence(motion: Motion, columns: Columns,
              loose: list[Candidate]) -> tuple[Blocks, list[JointGram]]:
    """
    Cut the blocks and sum all products of columns over them.

    :param loose: candidates of many columns, which a prior holds near 0.
    """
    tau, n = motion.samples.tau, motion.samples.n_joints
    residual = np.column_stack([_left(columns, motion, joint) for joint in range(n)])
    blocks = cut(motion.samples, residual)
    sigma = np.maximum(residual.std(axis=0), 1e-6 * max(float(tau.std()), 1e-9))
    common = np.sqrt((columns.shared ** 2).mean(axis=(0, 1)))
    grams = []
    for joint in range(n):
        x = columns.of_joint(joint)
        scale = np.concatenate([common, np.sqrt((columns.own[joint] ** 2).mean(axis=0))])
        scale[scale < 1e-12] = 1.0
        prior = np.zeros(x.shape[1])
        for candidate in loose:
            if candidate.joint == joint:
                prior[candidate.columns] = unknown_torque.PRIOR_BLOCKS * len(x) / blocks.count
        grams.append(joint_gram(x, tau[:, joint], blocks, scale, float(sigma[joint]), prior))
    return blocks, grams


def _left(columns: Columns, motion: Motion, joint: int) -> FloatArray:
    """Return what gravity, friction, offset and inertia leave of a joint's torque (M,)."""
    known = np.column_stack([columns.shared[:, joint, :columns.n_base],
                             nuisance(motion, joint)])
    tau = motion.samples.tau[:, joint]
    return np.asarray(tau - known @ np.linalg.lstsq(known, tau, rcond=1e-10)[0])
