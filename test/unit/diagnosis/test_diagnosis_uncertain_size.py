"""Effects of uncertain size: absorbed by gravity, small, or with an unresolved friction."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from bench.planning.scenes import Scene, wide_motion
from bench.shared.campaign import campaign
from bench.shared.serial_arms import serial_arm
import gravity_comp_ros
from gravity_comp_ros import Recording
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.diagnose import conclude, diagnose
from gravity_comp_ros.diagnosis.findings import FOUND, Verdict
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

BAGS = Path(__file__).resolve().parents[3] / 'bags'
JOINTS, NOISE = ('shoulder', 'elbow'), 0.02
SEEDS = pytest.mark.parametrize('seed', [0, *campaign(1, 2)])


def links(reach, own, seed, count=2000):
    """Return 100 s of two links in an upright plane; `own` (q, qd) -> N·m acts on the elbow."""
    t, rng = 0.05 * np.arange(count), np.random.default_rng(seed)
    phase, rates = rng.uniform(0.0, 6.0, 2), np.array([0.3, 0.43])
    q = reach * np.sin(rates * t[:, None] + phase)
    qd = reach * rates * np.cos(rates * t[:, None] + phase)
    both = 4.0 * np.sin(q.sum(axis=1))
    tau = np.column_stack([10.0 * np.sin(q[:, 0]) + both, both + own(q[:, 1], qd[:, 1])])
    return JointSamples.single_run(JOINTS, t, q, qd, tau + rng.normal(scale=NOISE, size=q.shape))


def test_rounding_error_is_no_finding():
    clean = read_bag(BAGS / 'eq15_test.mcap').samples
    diagnosis = diagnose(concatenate([clean, clean]))
    assert not diagnosis.findings


def on_elbow(reach, own, seed):
    samples = concatenate([links(reach, own, 10 * seed + k) for k in range(3)])
    return {f.effect: f for f in diagnose(samples).findings if f.joint == 'elbow'}


@SEEDS
def test_an_offset_is_established_in_wide_motion_and_at_most_tied_in_narrow_motion(seed):
    def offset(q, qd):
        return np.full(len(q), 0.5)

    # Gravity absorbs most of the slope of a spring.
    narrow, wide = (on_elbow(reach, offset, seed)['torque_offset'] for reach in (0.3, 1.2))
    assert narrow.verdict == Verdict.ESTABLISHED or narrow.rivals == ('joint_spring',)
    assert wide.verdict == Verdict.ESTABLISHED
    for finding in (narrow, wide):
        low, high = finding.coefficients['b'].ci95
        assert low <= 0.5 <= high


@pytest.mark.parametrize('ripple', [0.05, 0.0])
@SEEDS
def test_a_ripple_of_a_hundredth_of_the_friction_is_found_if_there_is_one(seed, ripple):
    def friction(q, qd):
        return 4.0 * np.tanh(qd / 0.005) + ripple * np.sin(12.0 * q)

    findings = on_elbow(1.4, friction, seed)
    assert findings['coulomb_friction'].verdict == Verdict.ESTABLISHED
    assert ('torque_ripple' in findings) == (ripple > 0.0)
    if ripple:
        low, high = findings['torque_ripple'].coefficients['a'].ci95
        assert low <= ripple <= high


@pytest.mark.parametrize('arm', ['iiwa7', *campaign('six_axis')])
def test_friction_at_one_speed_is_ambiguous_and_has_no_correction(arm):
    """At one speed viscous friction was an established hysteresis with an unresolved friction."""
    scene = Scene(arm, 'viscous_friction', 1, 'one_speed', 14)
    name = scene.arm_model.joints[1]
    findings = {f.effect: f for f in diagnose(scene.recorded()).findings if f.joint == name}
    assert findings['coulomb_friction'].verdict == Verdict.AMBIGUOUS
    assert findings['coulomb_friction'].rivals == ('viscous_friction',)
    assert set(findings) == {'coulomb_friction'}


@SEEDS
def test_the_sum_of_an_ambiguous_effect_and_its_alternatives_is_predicted(seed):
    """With other moments, a sensor that shows 6 % too much is one on the other joint."""
    def gained(seed):
        samples = links(1.2, lambda q, qd: np.zeros(len(q)), seed)
        return replace(samples, tau=samples.tau * [1.0, 1.06])

    train, later = gained(seed), Recording(gained(seed + 100))
    model = gravity_comp_ros.fit(Recording(train))
    diagnosis = gravity_comp_ros.diagnose(Recording(train), model)
    pair = {'torque_gain:shoulder', 'torque_gain:elbow'}
    assert [f.verdict for f in diagnosis.findings if set(f.to_add) == pair] == [Verdict.AMBIGUOUS]
    added = gravity_comp_ros.add_effects(model, Recording(train), diagnosis.findings)
    assert {e.target for e in added.gravity.applied.effects} == pair
    before, after = (max(joint.rmse for joint in gravity_comp_ros.compare(
        each, later).joints.values()) for each in (model, added))
    assert before > 5.0 * NOISE and after < 1.1 * 1.06 * NOISE
    # The interval of gravity alone contains that of the alternative.
    other = gravity_comp_ros.add_effects(model, Recording(train), diagnosis.findings[0].to_add[1:])
    difference = other.gravity.predict(train.q[::50]) - model.gravity.predict(train.q[::50])
    std = model.gravity.predict_std(train.q[::50])
    assert np.abs(difference).max() > 0.2 and (np.abs(difference) < 3.0 * std + 0.02).all()
    # `add` reports what `compare` measures, although each effect absorbs the other one.
    earlier, later_error = max(added.report.held_out.values())
    assert earlier == pytest.approx(before, rel=0.5) and later_error < 1.1 * 1.06 * NOISE


@pytest.mark.parametrize('gain, verdict', [(2.9, Verdict.WEAK), (3.1, Verdict.LIKELY)])
def test_a_finding_has_the_evidence_that_a_term_requires(offset_estimate, gain, verdict):
    regression = offset_estimate.regression
    weaker = replace(offset_estimate, regression=replace(
        regression, gains=dict.fromkeys(regression.gains, gain)))
    finding, = (f for f in conclude(weaker, None).findings if f.effect == 'torque_offset')
    assert finding.verdict == verdict and f'{gain} nats' in finding.why
    assert bool(finding.to_add) == (verdict == Verdict.LIKELY)


@pytest.fixture(scope='module')
def offset_estimate():
    return estimate(links(1.2, lambda q, qd: np.full(len(q), 0.5), 0))


@cache
def poor_model(scene):
    return fit(slow_samples(scene.recorded()).samples, FitOptions('chain')).model


def with_wide_motion(scene):
    """Return a poor recording, followed by 20 s of slow motion in half of the joints' range."""
    new = scene.later(wide_motion(scene.arm_model, scene.seed))
    return concatenate([scene.recorded(), new])


def of_joint(scene, samples):
    name = scene.arm_model.joints[scene.joint]
    diagnosis = diagnose(samples, poor_model(scene))
    return {f.effect: f for f in diagnosis.findings if f.joint == name}


@pytest.mark.parametrize('arm', ['right_six', *campaign('right_seven')])
def test_an_offset_is_established_with_wide_motion_and_nothing_else_in_narrow_motion(arm):
    scene = Scene(arm, 'torque_offset', 3, 'narrow', 21)
    narrow, wide = (of_joint(scene, samples)
                    for samples in (scene.recorded(), with_wide_motion(scene)))
    # One that gravity absorbs in narrow motion is predicted with it, and not missing later.
    if not poor_model(scene).applied.has('torque_offset', scene.arm_model.joints[3]):
        assert wide['torque_offset'].verdict == Verdict.ESTABLISHED
    named = [f for f in (*narrow.values(), *wide.values()) if f.verdict in FOUND]
    assert named
    for finding in named:
        assert finding.effect == 'torque_offset'
        low, high = finding.coefficients['b'].ci95
        assert low < 1.5 < high


SMALL_NOISE = 0.02


@pytest.mark.parametrize('seed', [0, *campaign(1, 2)])
@pytest.mark.parametrize('effect, torque', [
    ('torque_offset', lambda q: 0.4 + 0.0 * q), ('joint_spring', lambda q: 0.8 * (q - 0.3))])
def test_an_effect_on_it_is_named(seed, effect, torque):
    arm, rng = serial_arm(4, seed), np.random.default_rng(seed)
    motion = motions.multisine(np.full(4, -0.6), np.full(4, 0.6), np.full(4, 1.0), seed,
                               motions.MultisineOptions(0.15, 60.0), 60.0, 20.0)
    tau = gravity_torque(arm, motion.q) + SMALL_NOISE * rng.normal(size=motion.q.shape)
    tau[:, 0] += torque(motion.q[:, 0])
    samples = JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)
    named = {(f.effect, f.joint) for f in diagnose(samples).findings if f.verdict in FOUND}
    assert named == {(effect, arm.joints[0])}
