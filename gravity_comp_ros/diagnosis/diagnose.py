"""Diagnosis of a gravity model: which physical effects it does not model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.diagnosis.assemble import assemble, Assembled
from gravity_comp_ros.diagnosis.base import Base, choose_base, refined
from gravity_comp_ros.diagnosis.candidates import build, Candidate, Columns
from gravity_comp_ros.diagnosis.criteria import Criteria
from gravity_comp_ros.diagnosis.evidence import join_columns, sorted_joint_rows
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.diagnosis.nonparametric import PRIOR_BLOCKS, UnknownTorque
from gravity_comp_ros.diagnosis.options import DiagnosisOptions
from gravity_comp_ros.diagnosis.selection import select, Selection
from gravity_comp_ros.diagnosis.structure_check import check_structure
from gravity_comp_ros.diagnosis.structure_tests import STRUCTURE_TESTS
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.estimation.nuisance_columns import white_noise
from gravity_comp_ros.evaluation.blocks import cut
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

Progress = Callable[[str, float], None]

# Maximum number of samples of a motion, and approximate number of rows of a fit. Samples are
# autocorrelated, so more of them cost memory and add little information.
_MAX_SAMPLES = 40000
_ROWS = 5600
# Number of joints above which there are fewer rows, which limits memory.
_FULL_ROWS = 8
# Minimum scale of a column: its prior then counts as at most the inverse square of this, relative
# to the rows of a block.
_MIN_SCALE = 1e-2


@dataclass(frozen=True, eq=False)
class Evidence:
    """
    Base model and fits of a recording, before effects are selected.

    `span` (N,) is the range of the measured torque, `noise` (N,) the standard deviation of its
    white noise, both in N·m.
    """

    base: Base
    fits: Fits
    span: FloatArray
    noise: FloatArray


def diagnose(samples: JointSamples, model: GravityModel | None = None,
             options: DiagnosisOptions = DiagnosisOptions(),
             progress: Progress | None = None) -> Diagnosis:
    """
    Return the effects that explain the residual of the gravity model.

    :param samples: one or several runs, including fast motion (inertia is an effect too).
    :param model: the gravity model, including its effects; None fits one.
    :raises DataError: if there are too few samples.
    :raises ModelMismatchError: if a joint of the model is not among the samples.
    """
    return conclude(gather(samples, model, options.effects, progress), options, progress)


def gather(samples: JointSamples, model: GravityModel | None = None,
           effects: Sequence[str] | None = None, progress: Progress | None = None) -> Evidence:
    """
    Fit gravity, and compute the columns of effects and their products.

    :param effects: names of the effects to test; None for all.
    :raises: as `diagnose`.
    """
    report = progress or (lambda word, share: None)
    if model is not None:
        samples = samples.joints(model.joints)
    span = np.ptp(samples.tau, axis=0) if len(samples) else np.zeros(samples.n_joints)
    if model is not None:
        # Effects of the model are not findings; their size may change (`Base.given`).
        samples = replace(samples, tau=samples.tau - effect_torque(model, samples))
    noise = white_noise(samples)
    samples = samples.select(evenly_picked(samples.n_samples, _MAX_SAMPLES))
    report('gravity model', 0.0)
    base = choose_base(samples, model, _rows(samples))
    report('columns', 0.2)
    known = all_effects()
    named = [known[name] for name in (known if effects is None else effects)]
    others = [other for effect in named if (other := effect.alternative()) is not None]
    columns = build(base.motion, base.columns, named, others, [UnknownTorque()], STRUCTURE_TESTS)
    # All that is needed of these caches is in the columns now.
    base.motion.memo.clear()
    return Evidence(base, _fits(base, columns), span, noise)


def _rows(samples: JointSamples) -> int:
    """Return the number of rows of a fit: every k-th sample, evenly spaced."""
    n_rows = _ROWS * min(1.0, _FULL_ROWS / samples.n_joints) ** 2
    return max(1, -(-samples.n_samples // max(1, round(samples.n_samples / n_rows))))


def conclude(evidence: Evidence, options: DiagnosisOptions = DiagnosisOptions(),
             progress: Progress | None = None) -> Diagnosis:
    """Select effects by the evidence, and return the findings with their verdicts."""
    report = progress or (lambda word, share: None)
    base, fits = evidence.base, evidence.fits
    report('selection', 0.5)
    selection = select(_criteria(base, fits, options))
    better = refined(base, selection.effect_torque()) if selection.chosen else None
    if better is not None:
        report('selection', 0.7)
        fits = fits.with_gravity(better.columns)
        selection = select(_criteria(base, fits, options))
    report('verdicts', 0.8)
    assembled = _assembled(evidence, selection, options)
    laws = check_structure(fits, assembled.effects, base.motion.samples.names)
    report('verdicts', 1.0)
    return replace(assembled.diagnosis, laws=laws)


def _assembled(evidence: Evidence, selection: Selection, options: DiagnosisOptions) -> Assembled:
    """
    Return the diagnosis of selected effects, or of simpler ones with a smaller error.

    A friction law and its correction can mask each other, so that neither is significant in
    addition to the other and both are weak. Then the effects are selected again without the
    correction.
    """
    motion, span, noise = evidence.base.motion, evidence.span, evidence.noise
    first = assemble(selection, motion, span, noise, options.verdict)
    if not first.unresolved:
        return first
    simpler = assemble(select(selection.criteria, first.unresolved), motion, span, noise,
                       options.verdict)
    return simpler if _error(simpler) < _error(first) else first


def _error(assembled: Assembled) -> float:
    """Return the mean logarithm of the joints' errors with the effects to add."""
    return float(np.mean([np.log(max(report.rmse_after, 1e-12))
                          for report in assembled.diagnosis.joints.values()]))


def _criteria(base: Base, fits: Fits, options: DiagnosisOptions) -> Criteria:
    """Return the acceptance criteria of effects that the model does not include."""
    effects = tuple(c for c in fits.layout.candidates if c.key not in base.given)

    def implausible(candidate: Candidate, values: FloatArray) -> str | None:
        return candidate.effect.implausible(values, candidate.setting, base.motion,
                                            candidate.joint_index)

    return Criteria(fits, effects, implausible, options.selection, base.given)


def _fits(base: Base, columns: Columns) -> Fits:
    """Cut the recording into blocks and sum the products of columns; empties `columns.own`."""
    motion, layout = base.motion, columns.layout
    tau = motion.samples.tau
    blocks = cut(motion.samples, base.residual)
    sigma = np.maximum(base.residual.std(axis=0), 1e-6 * max(float(tau.std()), 1e-9))
    rows, information = [], _information(columns, motion)
    # Columns with little excitation are tiny. Divided by their RMS, their prior would dominate
    # the mean of the diagonal, to which the ridge of a solution is relative.
    mean_squares = np.concatenate([np.einsum('mnk,mnk->k', part, part)
                                   for part in columns.shared]) / tau.size
    common = np.maximum(np.sqrt(mean_squares),
                        _MIN_SCALE * float(sigma.max()) * np.sqrt(information / blocks.count))
    for joint, own in enumerate(columns.own):
        x = join_columns([*(part[:, joint] for part in columns.shared), *own],
                         blocks.by_fold[0])
        own.clear()
        mine = x[:, len(common):]
        scale = np.concatenate([common, np.sqrt(np.einsum('ij,ij->j', mine, mine) / len(x))])
        scale[scale < 1e-12] = 1.0
        prior = information * (float(sigma[joint]) ** 2 * len(x) / blocks.count)
        prior = np.concatenate([prior, np.zeros(x.shape[1] - len(prior))])
        # Unknown torques and structure tests have many columns, so a prior keeps them near 0.
        prior[layout.n_core[joint]:] = PRIOR_BLOCKS * len(x) / blocks.count
        rows.append(sorted_joint_rows(x, tau[:, joint], blocks, scale, float(sigma[joint]),
                                      prior, layout.n_core[joint]))
    return Fits(tuple(rows), layout, blocks)


def _information(columns: Columns, motion: Motion) -> FloatArray:
    """Return the prior information (S,) about shared coefficients, divided among the joints."""
    information = np.zeros(sum(part.shape[2] for part in columns.shared))
    for c in columns.layout.candidates:
        prior_std = c.effect.spread(motion, c.joint_index, c.setting) if c.shared else None
        if prior_std is not None:
            information[c.columns] = prior_std ** -2 / motion.samples.n_joints
    return information
