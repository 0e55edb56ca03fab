"""Learn which physical effect a gravity model is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.diagnosis.base import Base, choose_base, refined
from gravity_comp_ros.diagnosis.candidates import build, Candidate, Columns
from gravity_comp_ros.diagnosis.criteria import Criteria
from gravity_comp_ros.diagnosis.evidence import joint_rows, side_by_side
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.diagnosis.judge import judge
from gravity_comp_ros.diagnosis.laws import LAWS
from gravity_comp_ros.diagnosis.nonparametric import PRIOR_BLOCKS, UnknownTorque
from gravity_comp_ros.diagnosis.options import DiagnosisOptions
from gravity_comp_ros.diagnosis.selection import select
from gravity_comp_ros.diagnosis.structure_tests import check_laws
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.estimation.nuisance_columns import white_noise
from gravity_comp_ros.evaluation.blocks import cut
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

Progress = Callable[[str, float], None]

# Samples that a motion is built from, and about how many rows a fit has: neighbouring samples are
# alike, and more of them cost memory and say little.
_MOST_SAMPLES = 40000
_ROWS = 5600
# With more joints than this there are fewer rows, so that memory does not grow with their square.
_FULL_ROWS = 8
# Columns are divided by no less than makes their prior worth so much of the rows, to the power -2.
_LEAST_SCALE = 1e-2


@dataclass(frozen=True, eq=False)
class Evidence:
    """
    What a recording shows of every effect, before any is chosen.

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
    Rank the effects that would explain the residual of the gravity model.

    :param samples: one or several runs, fast motion included: inertia is an effect too.
    :param model: the gravity model to judge beside, with the effects that it has; None fits
        one.
    :raises DataError: if there are too few samples.
    :raises ModelMismatchError: if the samples lack a joint of the model.
    """
    return conclude(gather(samples, model, options.effects, progress), options, progress)


def gather(samples: JointSamples, model: GravityModel | None = None,
           effects: Sequence[str] | None = None, progress: Progress | None = None) -> Evidence:
    """
    Fit gravity, and sum what effects would explain beside it.

    :param effects: those to look for; None for all.
    :raises: as `diagnose`.
    """
    tell = progress or (lambda word, share: None)
    if model is not None:
        samples = samples.joints(model.joints)
    span = np.ptp(samples.tau, axis=0) if len(samples) else np.zeros(samples.n_joints)
    if model is not None:
        # What the model has already is not missing; its size may change (`Base.given`).
        samples = replace(samples, tau=samples.tau - effect_torque(model, samples))
    noise = white_noise(samples)
    samples = samples.select(evenly_picked(samples.n_samples, _MOST_SAMPLES))
    tell('gravity model', 0.0)
    base = choose_base(samples, model, _rows(samples))
    tell('columns', 0.2)
    known = all_effects()
    named = [known[name] for name in (known if effects is None else effects)]
    others = [other for effect in named if (other := effect.alternative()) is not None]
    columns = build(base.motion, base.columns, named, others, [UnknownTorque()], LAWS)
    return Evidence(base, _fits(base, columns), span, noise)


def _rows(samples: JointSamples) -> int:
    """Return how many rows a fit has: every k-th sample, so that they are evenly apart."""
    wanted = _ROWS * min(1.0, _FULL_ROWS / samples.n_joints) ** 2
    return max(1, -(-samples.n_samples // max(1, round(samples.n_samples / wanted))))


def conclude(evidence: Evidence, options: DiagnosisOptions = DiagnosisOptions(),
             progress: Progress | None = None) -> Diagnosis:
    """Choose effects by the evidence, and say how sure each one is."""
    tell = progress or (lambda word, share: None)
    base, fits = evidence.base, evidence.fits
    tell('selection', 0.5)
    selection = select(_criteria(base, fits, options))
    better = refined(base, selection.effect_torque()) if selection.chosen else None
    if better is not None:
        tell('selection', 0.7)
        fits = fits.beside(better.columns)
        selection = select(_criteria(base, fits, options))
    tell('verdicts', 0.8)
    judged = judge(selection, base.motion, evidence.span, evidence.noise, options.verdict)
    laws = check_laws(fits, judged.chosen, base.motion.samples.names)
    tell('verdicts', 1.0)
    return replace(judged.diagnosis, laws=laws)


def _criteria(base: Base, fits: Fits, options: DiagnosisOptions) -> Criteria:
    """Return what an effect with a name must pass."""
    effects = tuple(c for c in fits.layout.candidates if c.key not in base.given)

    def implausible(candidate: Candidate, values: FloatArray) -> str | None:
        return candidate.effect.implausible(values, candidate.setting, base.motion,
                                            candidate.place)

    return Criteria(fits, effects, implausible, options.selection, base.given)


def _fits(base: Base, columns: Columns) -> Fits:
    """Cut the blocks and sum the products of columns; `columns` are used up."""
    motion, layout = base.motion, columns.layout
    tau = motion.samples.tau
    blocks = cut(motion.samples, base.left)
    sigma = np.maximum(base.left.std(axis=0), 1e-6 * max(float(tau.std()), 1e-9))
    rows, usual = [], _information(columns, motion)
    # What hardly moves the arm has tiny columns. Divided by their size they would get a prior that
    # outweighs all other numbers, and the small ridge of a solution is relative to the mean.
    common = np.maximum(np.sqrt((columns.shared ** 2).mean(axis=(0, 1))),
                        _LEAST_SCALE * float(sigma.max()) * np.sqrt(usual / blocks.count))
    for joint, own in enumerate(columns.own):
        x = side_by_side([columns.shared[:, joint], *own])
        own.clear()
        scale = np.concatenate([common, np.sqrt((x[:, len(common):] ** 2).mean(axis=0))])
        scale[scale < 1e-12] = 1.0
        prior = usual * (float(sigma[joint]) ** 2 * len(x) / blocks.count)
        prior = np.concatenate([prior, np.zeros(x.shape[1] - len(prior))])
        # A prior keeps columns near 0 that are many, and of no known effect.
        prior[layout.n_core[joint]:] = PRIOR_BLOCKS * len(x) / blocks.count
        rows.append(joint_rows(x, tau[:, joint], blocks, scale, float(sigma[joint]), prior,
                               layout.n_core[joint]))
    return Fits(tuple(rows), layout, blocks)


def _information(columns: Columns, motion: Motion) -> FloatArray:
    """Return what is known of the shared coefficients (S,) before any data, by each joint."""
    known = np.zeros(columns.shared.shape[2])
    for c in columns.layout.candidates:
        usual = c.effect.spread(motion, c.place, c.setting) if c.shared else None
        if usual is not None:
            known[c.columns] = usual ** -2 / motion.samples.n_joints
    return known
