"""A friction law and its correction that mask each other; the error with the effects to add."""

from dataclasses import replace

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis import diagnose
from gravity_comp_ros.diagnosis.findings import FOUND, Verdict
from gravity_comp_ros.diagnosis.options import DiagnosisOptions
from gravity_comp_ros.diagnosis.selection import select, Selection
import numpy as np
import pytest

OPTIONS = DiagnosisOptions()
NOISE = 0.05


def pendulum(friction):
    """Return 60 s of a pendulum with inertia, at speeds up to 2 rad/s."""
    rng, t = np.random.default_rng(0), np.arange(0.0, 60.0, 0.02)
    frequencies, phases = rng.uniform(0.2, 2.5, 5), rng.uniform(0.0, 6.0, 5)
    sizes = rng.uniform(0.2, 0.8, 5) / (1.0 + 0.5 * frequencies)
    angles = np.outer(t, frequencies) + phases
    q, qd = np.sin(angles) @ sizes, np.cos(angles) @ (sizes * frequencies)
    qdd = -np.sin(angles) @ (sizes * frequencies ** 2)
    tau = 12.0 * np.sin(q) + 0.4 * qdd + friction(qd) + NOISE * rng.normal(size=t.shape)
    return JointSamples.single_run(('a',), t, q[:, None], qd[:, None], tau[:, None])


@pytest.fixture(scope='module')
def gathered():
    """Return the evidence and the criteria of a joint whose friction grows less than its speed."""
    samples = pendulum(lambda qd: 4.0 * np.sign(qd) * np.abs(qd) ** 0.4)
    evidence = diagnose.gather(samples)
    return evidence, diagnose._criteria(evidence.base, evidence.fits, OPTIONS)


def selected(criteria, *names):
    """Return a selection of effects by their names, with their first settings."""
    first = {c.effect.name: c for c in reversed(criteria.candidates)}
    return Selection(tuple(first[name] for name in names), {}, criteria)


def named(assembled):
    return {f.effect: f.verdict for f in assembled.diagnosis.findings}


def test_effects_that_mask_each_other_are_replaced_by_simpler_ones(gathered):
    """A joint with friction had no effect to add, since both of its laws were weak."""
    evidence, criteria = gathered
    # Coulomb friction would be an alternative of degressive friction, which is then ambiguous.
    few = tuple(c for c in criteria.candidates if c.effect.name != 'coulomb_friction')
    masked = selected(replace(criteria, candidates=few),
                      'viscous_friction', 'degressive_friction', 'inertia')
    first = diagnose.assemble(masked, evidence.base.motion, evidence.span, evidence.noise)
    assert first.unresolved == {('degressive_friction', 0)}
    assert {named(first)[name] for name in ('viscous_friction', 'degressive_friction')} == {
        Verdict.WEAK}
    verdicts = named(diagnose._assembled(evidence, masked, OPTIONS))
    assert verdicts['viscous_friction'] in FOUND


def test_without_masked_effects_the_selection_is_kept(gathered):
    evidence, criteria = gathered
    selection = select(criteria)
    assembled = diagnose._assembled(evidence, selection, OPTIONS)
    assert set(assembled.effects) == set(selection.chosen)
    assert not assembled.unresolved


def test_the_error_with_the_effects_to_add_excludes_the_weak_ones(gathered):
    """It was the error with all selected effects, which `add` of the findings did not reach."""
    evidence, criteria = gathered
    few = tuple(c for c in criteria.candidates if c.effect.name != 'coulomb_friction')
    masked = selected(replace(criteria, candidates=few),
                      'viscous_friction', 'degressive_friction', 'inertia')
    diagnosis = diagnose.assemble(masked, evidence.base.motion, evidence.span,
                                  evidence.noise).diagnosis
    to_add = [c for c in masked.chosen if c.effect.name == 'inertia']
    none, with_them, with_all = (float(np.sqrt(masked.fits.errors(0, chosen).sum()))
                                 for chosen in ([], to_add, masked.chosen))
    report = diagnosis.joints['a']
    assert report.rmse_after == pytest.approx(report.rmse_before * with_them / none, rel=1e-9)
    assert with_all < 0.2 * with_them
