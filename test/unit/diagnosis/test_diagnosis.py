"""Diagnosis: uncertain sizes, effects hardly separated, recordings that differ, large arms."""

from dataclasses import replace
from pathlib import Path

from bench.cases.arms import generated_arm
from bench.planning.scenes import Scene
from bench.shared.campaign import campaign
from bench.shared.rough_links import NOISE as LINK_NOISE, two_links
from bench.shared.serial_arms import serial_arm
import gravity_comp_ros
from gravity_comp_ros import Recording
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.diagnose import conclude, diagnose
from gravity_comp_ros.diagnosis.findings import FOUND, Verdict
from gravity_comp_ros.diagnosis.verdict import DiagnosisOptions
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.effects.registry import library_effects, requests
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import estimate
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, expand
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import gravity_torque
from gravity_comp_ros.simulation.disturbances.friction import Friction, LuGre
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
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


def test_an_unknown_effect_is_refused():
    with pytest.raises(OptionError, match="no effect 'coulomb'"):
        DiagnosisOptions(effects=('coulomb',))


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
    earlier, later_error = max(added.held_out.values())
    assert earlier == pytest.approx(before, rel=0.5) and later_error < 1.1 * 1.06 * NOISE


@pytest.mark.parametrize('gain, verdict', [(2.9, Verdict.WEAK), (3.1, Verdict.LIKELY)])
def test_a_finding_has_the_evidence_that_a_term_requires(offset_estimate, gain, verdict):
    regression = offset_estimate.regression
    weaker = replace(offset_estimate, regression=replace(
        regression, gains=dict.fromkeys(regression.gains, gain)))
    finding, = (f for f in conclude(weaker, None).findings if f.effect == 'torque_offset')
    assert finding.verdict == verdict and f'{gain} nats' in finding.why
    assert bool(finding.to_add) == (verdict == Verdict.LIKELY)


@pytest.mark.parametrize('left, verdict', [(0.01, Verdict.UNTESTABLE),
                                           (0.3, Verdict.ESTABLISHED)])
def test_a_torque_is_established_although_no_coefficient_is_identified(offset_estimate, left,
                                                                       verdict):
    """As of several harmonics over a short range: their sum is identified, no single one."""
    regression = offset_estimate.regression
    collinear = replace(offset_estimate, regression=replace(
        regression, identified={key: 0.0 * each for key, each in regression.identified.items()},
        unabsorbed=dict.fromkeys(regression.unabsorbed, left)))
    finding, = (f for f in conclude(collinear, None).findings if f.effect == 'torque_offset')
    assert finding.verdict == verdict and not finding.coefficients
    assert finding.base_absorbed == pytest.approx(1.0 - left)
    # Its sum with gravity is in the model already.
    assert not finding.to_add


@pytest.mark.parametrize('size_std, verdict', [(0.4, Verdict.ESTABLISHED), (0.6, Verdict.WEAK)])
def test_the_common_factor_of_the_coefficients_decides_whether_an_effect_may_be_zero(
        offset_estimate, size_std, verdict):
    """Intervals of collinear coefficients all cover 0 although their sum is certain."""
    regression = offset_estimate.regression
    own = regression.uncertainty
    for term in regression.terms:
        if term.n_columns == 1:
            (size,) = regression.posterior.beta[regression.posterior.at[term]]
            assert own.size_stds[term.key] == pytest.approx(
                own.stds[term.key][0] / abs(size), rel=1e-2)
    wide = replace(offset_estimate, regression=replace(regression, uncertainty=replace(
        own, stds={key: 1e3 * each for key, each in own.stds.items()},
        size_stds=dict.fromkeys(own.size_stds, size_std))))
    finding, = (f for f in conclude(wide, None).findings if f.effect == 'torque_offset')
    assert finding.verdict == verdict


def test_a_crank_spring_over_a_short_range_is_added():
    """Over 0.5 rad its harmonics are collinear: no coefficient differs from 0, the torque does."""
    samples = links(0.25, lambda q, qd: np.sin(2.0 * q) + 0.3 * np.cos(2.0 * q)
                    + 0.3 * np.sin(3.0 * q) + 0.1 * np.cos(3.0 * q), 0)
    finding, *_ = diagnose(samples).findings
    assert (finding.effect, finding.verdict) == ('joint_spring', Verdict.ESTABLISHED)
    assert finding.nrmse_after < 0.2 * finding.nrmse_before


@pytest.fixture(scope='module')
def offset_estimate():
    return estimate(links(1.2, lambda q, qd: np.full(len(q), 0.5), 0))


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


N = 10


@pytest.fixture(scope='module')
def samples():
    """Return two minutes of slow motion of ten joints, with 2 N·m of friction on the fourth."""
    arm = generated_arm(4, N, right_angles=True)
    friction = (Friction(3, LuGre(2.0)),)
    how = MultisineOptions(max_speed=0.2)
    return concatenate([
        synthesise(arm, multisine(arm.lower, arm.upper, np.full(N, 1.5), seed, how, 60.0, 10.0),
                   SynthesisOptions(NoiseOptions(absolute=0.05), seed, disturbances=friction))
        for seed in range(2)])


def test_the_slope_of_a_chain_with_many_terms_is_that_of_its_terms():
    rng = np.random.default_rng(0)
    axes = np.stack([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(7)])
    axes[np.linalg.det(axes) < 0.0, :, 0] *= -1.0
    chain = Chain(axes, rng.normal(size=(7, 2)))
    names = tuple('abcdefg')
    coverage = Coverage(np.full(7, -3.0), np.full(7, 3.0), 10)
    model = GravityModel.from_energy(names, 'chain', expand(chain), np.ones(7), coverage, {},
                                     chain)
    assert len(model.energy.indices) > 1000
    q = rng.uniform(-3.0, 3.0, (20, 7))
    by_terms = gravity_gradient(replace(model, chain=None, covariance=None), q)
    assert gravity_gradient(model, q) == pytest.approx(by_terms, abs=1e-7)


MORNING = 1.7e9
# Between the starts of recordings: on a clock, and where each begins at the same time.
CLOCKS = (100.0, 0.0)


def recorded(seed: int, offset: float, start: float) -> JointSamples:
    """Return a minute of two links at 5 Hz, of which the elbow has this offset more."""
    samples = two_links(seed).select(np.arange(0, 1200, 4))
    return replace(samples, tau=samples.tau + [0.0, offset], starts=(start,))


def offset_of(runs: list[JointSamples]):
    """Return the model with friction and offset added, and the elbow's offset in it."""
    samples = concatenate(runs)
    model = fit(samples).model
    findings = diagnose(samples, model).findings
    targets = [f'{f.effect}:{f.joint}' for f in findings if f.verdict in FOUND and f.joint]
    assert set(targets) >= {'torque_offset:elbow', 'coulomb_friction:shoulder'}
    model = refit(samples, model, requests(targets, samples.names)).model
    return model, next(e for e in model.applied.effects if e.name == 'torque_offset')


def rmse(model, samples: JointSamples) -> float:
    """Return the error of the elbow, N·m."""
    return float(np.sqrt(((predict_torque(model, samples) - samples.tau)[:, 1] ** 2).mean()))


@pytest.mark.parametrize('step', [CLOCKS[1], *campaign(CLOCKS[0])])
@pytest.mark.parametrize('seed', [0, *campaign(10)])
def test_the_offset_of_each_recording_is_found_and_the_mean_is_predicted_later(seed, step):
    offsets = [1.2, -0.9, 0.3]
    runs = [recorded(seed + k, offset, MORNING + step * k) for k, offset in enumerate(offsets)]
    model, offset = offset_of(runs)
    # `two_links` has an offset of 0.4 N·m itself.
    truth = {'b': 0.6, 'd_1': 1.0, 'd_2': -1.1}
    assert set(offset.coefficients) == set(truth)
    for symbol, value in truth.items():
        low, high = offset.coefficients[symbol].ci95
        assert low - 0.02 < value < high + 0.02 and high - low < 0.3
    for run in runs:
        assert rmse(model, run) < 1.2 * LINK_NOISE
    assert rmse(model, recorded(seed + 5, 0.2, MORNING + 50 * step)) < 1.2 * LINK_NOISE
    assert rmse(model, recorded(seed + 6, 1.2, MORNING + 60 * step)) == pytest.approx(1.0, abs=0.1)


def test_one_offset_in_all_recordings_is_one_coefficient():
    model, offset = offset_of([recorded(k, 0.5, MORNING + 100.0 * k) for k in range(2)])
    assert set(offset.coefficients) == {'b'}
    low, high = offset.coefficients['b'].ci95
    assert low < 0.9 < high


def test_a_spring_at_rest_far_outside_is_no_alternative_to_an_offset():
    spring = library_effects()['joint_spring']
    linear, crank = {'centre': 0.1, 'overtones': 0.0}, {'centre': 0.1, 'overtones': 1.0}
    assert spring.implausible(np.array([0.2, 1.2]), linear) is None
    assert '360 degrees' in spring.implausible(np.array([-0.2, 1.3]), linear)
    assert spring.implausible(np.array([0.0, 1.3]), crank) is None


def test_of_a_size_that_is_not_physical_the_alternatives_are_added(monkeypatch):
    """Its torque is certain: with other moments, a gain is one on the other joint."""
    samples = links(1.2, lambda q, qd: np.zeros(len(q)), 0)
    estimated = estimate(replace(samples, tau=samples.tau * [1.0, 1.06]))
    before, *_ = conclude(estimated, None).findings
    assert before.verdict is Verdict.AMBIGUOUS and len(before.to_add) == 2
    monkeypatch.setattr(type(library_effects()['torque_gain']), 'implausible',
                        lambda *_: 'it is too good to be true')
    after, *_ = conclude(estimated, None).findings
    assert after.verdict is Verdict.AMBIGUOUS and 'too good to be true' in after.why
    assert after.to_add == before.to_add[1:]


def test_an_offset_that_differs_between_recordings_is_no_payload_in_an_update():
    runs = [recorded(k, offset, MORNING) for k, offset in enumerate([1.2, -0.9])]
    model, later = fit(concatenate(runs)).model, recorded(7, 0.9, MORNING)
    changed = update(model, later).model
    at = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 2))
    assert np.abs(changed.predict(at) - model.predict(at)).max() < 0.15


def gains_of(gains, step=100.0):
    """Return three recordings whose efforts of the shoulder have these gains, and the findings."""
    runs = []
    for k, gain in enumerate(gains):
        samples = two_links(20 + k).select(np.arange(0, 1200, 4))
        runs.append(replace(samples, tau=samples.tau * [gain, 1.0],
                            starts=(MORNING + step * k,)))
    samples = concatenate(runs)
    model = fit(samples).model
    return samples, model, {(f.effect, f.joint): f for f in diagnose(samples, model).findings
                            if f.verdict in FOUND}


@pytest.mark.parametrize('step', [CLOCKS[0], *campaign(CLOCKS[1])])
def test_a_gain_of_each_recording_is_found_and_the_mean_is_predicted_later(step):
    samples, model, findings = gains_of([1.1, 0.95, 1.0], step)
    gain = findings['torque_gain', 'shoulder'].coefficients
    # The mean gain is part of gravity; the deviations are relative to it.
    assert set(gain) == {'k', 'd_1', 'd_2'}
    for symbol, true in (('d_1', 1.1 - 1.0167), ('d_2', 0.95 - 1.0167)):
        assert gain[symbol].value == pytest.approx(true, abs=0.015)
    assert not any(effect == 'payload_change' for effect, _ in findings)
    targets = [f'{effect}:{joint}' for effect, joint in findings if joint]
    model = refit(samples, model, requests(targets, samples.names)).model
    later = two_links(30)
    later = replace(later, tau=later.tau * [1.0167, 1.0], starts=(MORNING + 10 * step,))
    error = (predict_torque(model, later) - later.tau)[:, 0]
    assert np.sqrt((error ** 2).mean()) < 2.0 * LINK_NOISE
