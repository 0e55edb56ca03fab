"""Updates after a payload change, without and with known axes, and fits on known axes."""

from dataclasses import replace
from pathlib import Path

from bench.cases.arms import generated_arm, small_motion
from bench.shared.campaign import campaign
from bench.shared.serial_arms import samples_of, worst
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import DataError, FitError, ModelMismatchError, OptionError
from gravity_comp_ros.estimation.chain_update import _spread
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.payload_path import path_moments, payload_path
from gravity_comp_ros.estimation.update import reversal_std, update
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.arms import gravity_torque, Payload, with_payload
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

ARM, NOISE = arms.iiwa7(), 0.1
LATER = motions.eq17(start=100.0).q
IIWA = described_arm((Path(__file__).resolve().parents[3] / 'bags' / 'iiwa7.urdf').read_bytes(),
                     ARM.joints).geometry
COM = (0.02, 0.03, 0.1)
SLOW = motions.MultisineOptions(max_speed=0.1)


def recorded(arm, q, seed: int = 1) -> JointSamples:
    return samples_of(q, gravity_torque(arm, q), NOISE, seed, arm.joints)


@pytest.fixture(scope='module')
def old(iiwa_model_file):
    """Return models of the bare iiwa by formulation: of Yu 2022, Eq. (17), and random poses."""
    anywhere = recorded(ARM, motions.random_poses(ARM.lower, ARM.upper, 250).q, 0)
    return {'chain': load_model(iiwa_model_file),
            'potential': fit(anywhere, FitOptions('potential')).model}


@pytest.mark.parametrize('formulation, seed, mass, com, known', [
    ('chain', 1, 2.0, COM, True), ('potential', 3, 4.0, COM, True),
    ('chain', 1, 2.0, (0.0, 0.0, 0.1), False)])
def test_torque_mass_and_centre_from_ten_seconds(old, formulation, seed, mass, com, known):
    loaded = with_payload(ARM, Payload(mass, com))
    result = update(old[formulation], recorded(loaded, LATER[:50], seed),
                    geometry=IIWA if known else None)
    wide = np.random.default_rng(1).uniform(-ARM.upper, ARM.upper, (300, 7))
    assert worst(old[formulation], loaded, LATER) > 5.0
    assert worst(result.model, loaded, LATER) <= 0.05
    assert worst(result.model, loaded, wide) <= (0.15 if known else 0.2)
    assert result.model.formulation == 'chain' and result.report.warnings == ()
    for q in (LATER, wide):
        error = np.abs(recorded(loaded, q, seed=9).tau - result.model.predict(q))
        band = 1.96 * np.hypot(result.model.predict_std(q), result.model.noise)
        assert (error <= band).mean() >= 0.9
    payload = result.report.payload
    if not known:
        assert payload is None
        return
    assert payload.mass.value == pytest.approx(mass, rel=0.03)
    centre = [payload.centre[axis].value for axis in 'xyz']
    assert centre == pytest.approx(com, abs=0.005)
    low, high = payload.mass.ci95
    assert 0.005 < high - low < 0.1
    assert payload.link == 'iiwa_link_7'


def test_intervals_cover_the_truth(old):
    loaded = with_payload(ARM, Payload(2.0, COM))
    truth = np.array([2.0, *COM])
    # The trials share the error of the old model, so they are not independent.
    inside = []
    for seed in range(4):
        payload = update(old['chain'], recorded(loaded, LATER[:50], seed),
                         geometry=IIWA).report.payload
        limits = np.array([payload.mass.ci95, *(payload.centre[axis].ci95 for axis in 'xyz')])
        inside.append((limits[:, 0] <= truth) & (truth <= limits[:, 1]))
    assert np.mean(inside) >= 0.85


def test_the_inertia_of_a_payload_is_not_taken_for_mass():
    """The model has the dynamics of the arm; those of the payload are subtracted too."""
    def moving(seed, duration, payload=None):
        motion = motions.multisine(ARM.lower, ARM.upper, ARM.max_speed, seed, SLOW, duration, 50.0)
        return synthesise(ARM, motion, SynthesisOptions(
            NoiseOptions(0.0, 0.05), seed, payload=payload))

    model = fit(moving(1, 100.0), FitOptions('chain', geometry=IIWA)).model
    assert model.fitted.has(DYNAMICS, None)
    for seed in (203, 205):
        loaded = slow_samples(moving(seed, 40.0, Payload(3.0, (0.0, 0.0, 0.1)))).samples
        mass = update(model, loaded, geometry=IIWA).report.payload.mass
        assert mass.value == pytest.approx(3.0, rel=0.0025)
        assert mass.ci95[0] < 3.0 < mass.ci95[1]


def test_a_removed_payload_has_a_negative_mass(old):
    loaded = with_payload(ARM, Payload(1.5, COM))
    held = update(old['chain'], recorded(loaded, LATER[:50], 1), geometry=IIWA).model
    bare = update(held, recorded(ARM, LATER[50:100], 2), geometry=IIWA)
    assert bare.report.payload.mass.value == pytest.approx(-1.5, rel=0.03)
    assert worst(bare.model, ARM, LATER) <= 0.05
    assert len(bare.model.provenance['updates']) == 2
    # Without a payload there is no centre.
    updated = update(old['chain'], recorded(ARM, LATER[:50], 1), geometry=IIWA)
    low, high = updated.report.payload.mass.ci95
    assert low < 0.0 < high and updated.report.payload.centre is None


def test_a_change_that_is_no_payload_is_reported(old):
    # A weight on the upper arm: no payload changes the torque of joint 2 alone.
    q = LATER[:50]
    tau = gravity_torque(ARM, q)
    tau[:, 1] += 6.0 * np.sin(q[:, 1])
    result = update(old['chain'], samples_of(q, tau, NOISE, 1, IIWA.joints), geometry=IIWA)
    assert any('rigid body' in line for line in result.report.warnings)
    error = result.model.predict(q) - tau
    assert np.sqrt((error ** 2).mean(axis=0)).max() <= 0.1


def test_axes_of_another_arm_are_rejected(old):
    wrong = Geometry(IIWA.joints, np.concatenate([IIWA.rotations[:3], IIWA.rotations[4:],
                                                  IIWA.rotations[3:4]]),
                     IIWA.origins, IIWA.link, IIWA.link_rotation)
    samples = recorded(ARM, motions.eq17().q[::10], 0)
    result = fit(samples, FitOptions('chain', geometry=wrong))
    assert not result.report.known_axes and result.report.warnings
    with pytest.raises(ModelMismatchError, match='do not reproduce the model'):
        update(old['chain'], recorded(ARM, LATER[:50], 1), geometry=wrong)


def test_joints_in_another_order_are_matched(old):
    order = (3, 1, 0, 2, 6, 5, 4)
    loaded = with_payload(ARM, Payload(2.0, COM))
    new = recorded(loaded, LATER[:50], 1)
    mixed = new.joints([new.names[k] for k in order])
    result = update(old['chain'], mixed, geometry=IIWA)
    assert result.model.joints == IIWA.joints
    assert result.report == update(old['chain'], new, geometry=IIWA).report


def test_axes_of_other_joints_are_refused(old):
    samples = recorded(ARM, motions.eq17().q, 0)
    with pytest.raises(ModelMismatchError, match='the known axes are of'):
        fit(samples.joints(samples.names[::-1]), FitOptions('chain', geometry=IIWA))
    other = Geometry(tuple('abcdefg'), IIWA.rotations, IIWA.origins, 'l', np.eye(3))
    with pytest.raises(ModelMismatchError, match='model is of'):
        update(old['chain'], recorded(ARM, LATER[:50], 1), geometry=other)
    with pytest.raises(DataError, match='geometry of a, b'):
        replace(old['chain'], geometry=other)
    with pytest.raises(OptionError, match='potential does not use known axes'):
        FitOptions('potential', geometry=IIWA)


@pytest.mark.parametrize('kind, share', [
    ('chain', 0.03), ('known axes', 0.0), *campaign(('potential', 0.03))])
def test_a_payload_where_the_drive_subtracts_its_own_gravity(kind, share):
    """The share is the error of the drive's model; inertia remains in the effort."""
    bare, names = ARM, ARM.joints

    def effort(arm, motion, seed):
        tau = arms.inverse_dynamics(arm, motion.q, motion.qd, motion.qdd)
        tau -= (1.0 - share) * gravity_torque(bare, motion.q)
        tau += np.random.default_rng(seed).normal(0.0, 0.05, tau.shape)
        return JointSamples.single_run(names, motion.t, motion.q, motion.qd, tau)

    options = FitOptions('chain', geometry=IIWA) if kind == 'known axes' else FitOptions(kind)
    model = fit(effort(bare, motions.eq17(60.0), 0), options).model
    loaded = with_payload(bare, Payload(2.0, COM))
    payload = update(model, effort(loaded, motions.eq17(60.0, start=100.0), 1),
                     geometry=IIWA).report.payload
    assert payload.mass.value == pytest.approx(2.0, rel=0.03)
    assert [payload.centre[axis].value for axis in 'xyz'] == pytest.approx(COM, abs=0.005)


@pytest.fixture(scope='module')
def wide():
    return np.random.default_rng(1).uniform(ARM.lower, ARM.upper, (500, 7))


def test_report_contains_the_torque_of_the_payload(old):
    arm = with_payload(ARM, Payload(2.0, (0.0, 0.0, 0.1)))
    result = update(old['chain'], recorded(arm, LATER[:50]))
    report = result.report
    expected = (gravity_torque(arm, LATER[:50])
                - gravity_torque(ARM, LATER[:50])).mean(axis=0)
    assert list(report.effect_mean.values()) == pytest.approx(expected, abs=0.1)
    assert report.rmse['iiwa_joint_2'] < 0.2 < report.rmse_before['iiwa_joint_2']
    assert report.solver.converged and report.n_samples == 50
    assert {name.split()[0] for name in report.changed} <= set(arm.joints)


def test_an_unidentified_axis_is_identified_with_the_payload(old, wide):
    # The axis of joint 7 without payload has no moment; that of the payload identifies it.
    arm = with_payload(ARM, Payload(2.0, (0.05, 0.0, 0.1)))
    model = old['chain']
    moments, std = model.chain.moments[6], np.sqrt(np.diag(model.covariance)[-2:])
    # The payload has 1 N·m.
    assert (np.abs(moments) < 3.0 * std).all() and np.abs(moments).max() < 0.1
    model = update(model, recorded(arm, LATER[:50])).model
    error = (model.predict(wide) - gravity_torque(arm, wide))[:, 6]
    assert np.sqrt((error ** 2).mean()) <= 0.1


def test_an_update_warns_of_a_large_uncertainty(old):
    loaded = with_payload(ARM, Payload(2.0, (0.02, 0.03, 0.1)))
    few = update(old['chain'], recorded(loaded, LATER[:12], 3))
    assert any('may be off by' in message for message in few.report.warnings)
    assert update(old['chain'], recorded(loaded, LATER[:100])).report.warnings == ()


def test_invalid_updates_are_refused(old):
    model = old['chain']
    with pytest.raises(FitError, match='an update needs 10'):
        update(model, recorded(ARM, LATER[:9]))
    others = samples_of(LATER[:50], np.zeros((50, 7)), 0.1, 0, tuple('abcdefg'))
    with pytest.raises(ModelMismatchError, match='no joint'):
        update(model, others)
    with pytest.raises(ModelMismatchError, match='no chain of joints explains this per_joint'):
        sines = tuple(Expansion(np.array([3 ** (6 - n)]), np.array([5.0])) for n in range(7))
        update(replace(model, formulation='per_joint', torques=sines, energy=None, chain=None,
                       covariance=None), recorded(ARM, LATER[:50]))


def test_differences_between_hypotheses_are_part_of_the_uncertainty(old, wide):
    """Two equally probable chains whose last axes differ by 0.1 rad, without other uncertainty."""
    chain = old['chain'].chain
    loaded = chain.moved(np.concatenate([np.zeros(14), np.full(14, 2.0)]))
    step = np.zeros(28)
    step[12] = 0.1
    other = loaded.moved(step)
    torques = np.array([loaded.torque(wide), other.torque(wide)])
    covariance = _spread(loaded, wide, torques, np.full(2, 0.5))
    std = replace(old['chain'], chain=loaded, covariance=covariance).predict_std(wide)
    difference = np.abs(other.torque(wide) - loaded.torque(wide))
    np.testing.assert_allclose(std, difference / np.sqrt(2.0), atol=0.05 * difference.max())
    assert difference.max() > 0.1
    single = _spread(loaded, wide, torques[:1], np.ones(1))
    np.testing.assert_allclose(single, 0.0, atol=1e-12)


NO_ENERGY = Expansion(np.zeros(0, dtype=np.int64), np.zeros(0))


@pytest.mark.parametrize('law', [{'width': 0.02}, {'ramp': 0.02}])
def test_friction_is_uncertain_near_reversals_only(law):
    speeds = np.array([0.0, 0.02, 0.1, -0.02])
    samples = JointSamples.single_run(('a', 'b'), np.arange(4.0), np.zeros((4, 2)),
                                      np.column_stack([speeds, speeds]), np.zeros((4, 2)))
    friction = AppliedEffect('coulomb_friction', 'a', law, {
        'F_c': Value(3.0, 'N·m', (2.8, 3.2))})
    model = GravityModel(('a', 'b'), 'potential', (NO_ENERGY, NO_ENERGY), NO_ENERGY, np.zeros(2),
                         Coverage(np.zeros(2), np.zeros(2), 4), fitted=Applied((friction,)))
    std = reversal_std(model, samples)
    # The speed of the reversal changes by the factor 1.8 with the payload.
    slow, quick = (1.0 / 1.8, 1.0) if 'ramp' in law else (np.tanh(1.0 / 1.8), np.tanh(1.8))
    assert std[1, 0] == std[3, 0] == pytest.approx(1.5 * (quick - slow))
    assert std[0, 0] == 0.0 and std[2, 0] < 0.05 and not std[:, 1].any()


FIRST, SECOND = Payload(2.0, (0.02, -0.01, 0.1)), Payload(0.9, (-0.03, 0.02, 0.06))


def samples(arm, seed, start, duration, payload=None):
    motion = small_motion(arm, seed, duration, 5.0, start)
    carried = arm if payload is None else with_payload(arm, payload)
    noise = 0.1 * np.random.default_rng([seed, int(start)]).normal(size=motion.q.shape)
    return JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd,
                                   gravity_torque(carried, motion.q) + noise)


@pytest.fixture(scope='module', params=[0, *campaign(1, 2)])
def learned(request):
    """Return an arm, its seed, and its models without payload and with the first one."""
    seed = request.param
    arm = generated_arm(seed, right_angles=True)
    bare = fit(samples(arm, seed, 0.0, 100.0), FitOptions('chain')).model
    return arm, seed, bare, update(bare, samples(arm, seed, 100.0, 60.0, FIRST)).model


def error(model, arm, payload):
    q = np.random.default_rng(3).uniform(model.coverage.q_min, model.coverage.q_max,
                                         (500, arm.n_joints))
    difference = model.predict(q) - gravity_torque(with_payload(arm, payload), q)
    return np.sqrt((difference ** 2).mean(axis=0)).max()


def test_the_path_has_the_torque_of_the_payload(learned):
    arm, _, bare, first = learned
    assert bare.payload_path is None
    box = np.stack([bare.coverage.q_min, bare.coverage.q_max])
    moments = path_moments(first.payload_path, first.chain, box)
    q = np.random.default_rng(4).uniform(box[0], box[1], (200, arm.n_joints))
    columns = np.eye(2 * arm.n_joints)
    change = sum(x * replace(first.chain, moments=unit.reshape(-1, 2)).torque(q)
                 for x, unit in zip(moments, columns))
    true = gravity_torque(with_payload(arm, FIRST), q) - gravity_torque(arm, q)
    assert np.sqrt(((change - true) ** 2).mean(axis=0)).max() < 0.2


@pytest.mark.campaign
def test_the_next_payload_requires_less_motion():
    with_path, without = [], []
    for seed in range(6):
        arm = generated_arm(seed, right_angles=True)
        bare = fit(samples(arm, seed, 0.0, 100.0), FitOptions('chain')).model
        first = update(bare, samples(arm, seed, 100.0, 60.0, FIRST)).model
        short = samples(arm, seed, 160.0, 8.0, SECOND)
        with_path.append(error(update(first, short).model, arm, SECOND))
        without.append(error(update(replace(first, payload_path=None), short).model, arm, SECOND))
    assert max(with_path) < 0.2 and np.mean(with_path) < 0.8 * np.mean(without)


def test_the_larger_change_is_kept_and_saved(learned, tmp_path):
    arm, seed, bare, first = learned
    second = update(first, samples(arm, seed, 160.0, 20.0, SECOND)).model
    np.testing.assert_array_equal(second.payload_path.weights, first.payload_path.weights)
    save_model(tmp_path / 'm.json', second)
    read = load_model(tmp_path / 'm.json')
    np.testing.assert_array_equal(read.payload_path.indices, second.payload_path.indices)
    np.testing.assert_array_equal(read.payload_path.weights, second.payload_path.weights)
    # A change within the noise is not kept.
    assert payload_path(bare, update(bare, samples(arm, seed, 100.0, 20.0)).model) is None
