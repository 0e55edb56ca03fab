"""A new model passes tests that do not ask its own samples alone; a real payload passes them."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
import sys

from broken_effort import KINDS
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.urdf import read_urdf
from gravity_comp_ros.errors import FitError, OptionError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.subset_stability import instability
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.node.absolute_tests import (
    dead_joint, first_model_objection, lost_gravity, reference_noise)
from gravity_comp_ros.node.base_chain import as_chain
from gravity_comp_ros.node.fit_job import work
from gravity_comp_ros.node.outliers import outliers_of_change, rms_without
from gravity_comp_ros.node.payload import PayloadLimits
from gravity_comp_ros.node.payload_test import objections, PayloadEvidence
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'bench'))
pytest.importorskip('pinocchio')
bench = import_module('node_acceptance')
ARM, job_of, Payload, recorded = bench.ARM, bench.job_of, bench.Payload, bench.recorded


@pytest.fixture(scope='module')
def base():
    bare = recorded('eq17', 0, 100.0, 0.0, None, 'bare', np.random.default_rng(5))
    return fit(bare.samples, FitOptions(formulation='chain')).model


@pytest.fixture(scope='module')
def geometry():
    return read_urdf(ROOT / 'bags' / 'iiwa7.urdf', ARM.joints)


def spoiled(name, n=100, seed=1):
    rng = np.random.default_rng(seed)
    case = recorded('eq17', seed, n / 5.0, 50.0, Payload(2.0), name, rng)
    s = case.samples
    return replace(case, samples=JointSamples.single_run(
        s.names, s.t, s.q, s.qd, KINDS[name](s.tau, rng)))


# Seconds of CPU each; the others are in bench/node_acceptance.py.
@pytest.mark.parametrize('name', ['drives off', 'dead elbow', 'flipped shoulder', 'all flipped'])
def test_broken_effort_is_refused(name, base, geometry):
    found = work(job_of(spoiled(name), base, geometry)).verdict
    assert found.broken and not found.better and found.broken in found.reason


@pytest.mark.parametrize('mass, centre', [(0.3, (0.0, 0.0, 0.1)), (5.0, (0.12, -0.1, 0.1))])
def test_a_real_payload_is_taken_within_twenty_seconds(mass, centre, base, geometry):
    case = recorded('eq17', 0, 20.0, 80.0, Payload(mass, centre), 'real',
                    np.random.default_rng(2))
    outcome = work(job_of(case, base, geometry))
    assert outcome.verdict.better, outcome.verdict.reason
    assert np.abs(outcome.model.predict(case.later) - case.truth).max() < 0.5


def gripped(tau, rng):
    """Return effort with a brake that grips for half a second, about every eight seconds."""
    found, k = tau.copy(), int(rng.integers(5, 15))
    while k < len(found):
        found[k:k + 3, int(rng.integers(0, 5))] += rng.choice([-1.0, 1.0]) * 10.0
        k += int(rng.integers(20, 60))
    return found


@pytest.mark.parametrize('seconds, seed', [(8.0, 2), (20.0, 1), (20.0, 4)])
def test_a_brake_now_and_then_is_left_out_and_the_payload_learned(seconds, seed, base):
    rng = np.random.default_rng(seed)
    case = recorded('eq17', seed, seconds, 60.0 + 23.0 * seed, Payload(2.0), 'brake', rng)
    samples = replace(case.samples, tau=gripped(case.samples.tau, rng))
    found = work(job_of(replace(case, samples=samples), base))
    assert found.verdict.better, found.verdict.reason
    assert found.outliers and sum(found.outliers.values()) < 0.2 * len(samples)
    assert np.abs(found.model.predict(case.later) - case.truth).max() < 0.5
    clean = work(job_of(case, base))
    assert not clean.outliers


def test_a_transient_does_not_keep_a_first_model_out():
    # A controller that catches the arm makes some N·m on a joint that carries no gravity.
    samples = recorded('eq17', 0, 60.0, 0.0, None, '', np.random.default_rng(3)).samples
    tau = samples.tau + np.tanh(samples.qd / 0.01)
    tau[100:104, 0] += [9.0, -9.0, 7.0, -7.0]
    samples = replace(samples, tau=tau)
    job = job_of(bench.Case('', samples, samples.q, tau), None)
    found = work(job)
    assert found.verdict.better, found.verdict.reason
    assert set(found.outliers) == {ARM.joints[0]} and sum(found.outliers.values()) <= 4


def test_a_joint_that_is_broken_for_long_is_no_outlier(base):
    samples = recorded('eq17', 0, 20.0, 80.0, Payload(2.0), '', np.random.default_rng(2)).samples
    tau = samples.tau.copy()
    tau[40:, 1] = 0.0
    assert not outliers_of_change(replace(samples, tau=tau), base).any()


def evidence(base, change, noise=0.1):
    """Return what a chain whose moments change by `change` (N, 2) measures."""
    samples = recorded('eq17', 0, 20.0, 30.0, None, '', np.random.default_rng(0)).samples
    moved = base.chain.moved(np.concatenate([np.zeros(14), np.ravel(change)]))
    tau = moved.torque(samples.q) + noise * np.random.default_rng(1).standard_normal((100, 7))
    samples = replace(samples, tau=tau)
    loaded = replace(base, chain=moved,
                     torques=base.torques, energy=base.energy)
    loaded.__dict__['predict'] = moved.torque
    return PayloadEvidence(base, loaded, samples, samples, np.full(7, noise))


def moments(**changed):
    found = np.zeros((7, 2))
    for name, value in changed.items():
        found[int(name[1:]), 0] = value
    return found


def test_a_change_of_the_shoulder_alone_is_no_payload(base):
    why = list(objections(evidence(base, moments(m1=10.0)), PayloadLimits()))
    assert any('only the moment at iiwa_joint_2 changed' in text for text in why)
    assert not list(objections(evidence(base, moments(m1=10.0, m3=9.0)), PayloadLimits()))


def test_a_change_beyond_max_payload_is_refused(base):
    heavy = evidence(base, moments(m1=60.0, m3=50.0))
    assert not list(objections(heavy, PayloadLimits()))
    assert 'max_payload 5 kg' in next(objections(heavy, PayloadLimits(mass=5.0)))


def test_one_factor_for_all_joints_is_no_payload(base):
    doubled = evidence(base, base.chain.moments)
    assert 'all joints is 2 times' in list(objections(doubled, PayloadLimits(mass=100.0)))[-1]


def test_known_axes_bound_mass_and_reach(base, geometry):
    case = recorded('eq17', 0, 20.0, 80.0, Payload(3.0, (0.0, 0.0, 0.4)), '',
                    np.random.default_rng(2)).samples
    base = as_chain(base, geometry)
    found = PayloadEvidence(base, base, case, case, np.full(7, 0.1))
    assert not list(objections(found, PayloadLimits(), geometry))
    assert 'max_payload is 2 kg' in next(objections(found, PayloadLimits(mass=2.0), geometry))
    assert 'max_payload_reach' in next(objections(found, PayloadLimits(reach=0.2), geometry))


def test_a_potential_model_of_a_serial_arm_is_a_chain(base):
    bare = recorded('eq17', 0, 60.0, 0.0, None, 'bare', np.random.default_rng(5)).samples
    model = fit(bare, FitOptions(formulation='potential')).model
    chain = as_chain(model)
    assert chain.formulation == 'chain'
    assert np.abs(chain.predict(bare.q) - model.predict(bare.q)).max() < 0.3
    no_chain = replace(model, uncertainty=None)
    assert as_chain(no_chain) is None


def test_noise_of_today_counts_where_it_is_larger():
    rng = np.random.default_rng(0)
    t = 0.2 * np.arange(400)
    q = np.stack([np.sin(0.1 * t), np.cos(0.1 * t)], axis=1)
    tau = 20.0 * q + np.array([0.05, 1.0]) * rng.standard_normal(q.shape)
    samples = JointSamples.single_run(['a', 'b'], t, q, 0 * q, tau)
    found = reference_noise(np.full(2, 0.1), samples, 19.0 * q)
    assert found[0] == 0.1 and found[1] == pytest.approx(1.0, rel=0.2)


def test_a_first_model_must_explain_every_joint():
    q = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    samples = JointSamples.single_run(['a', 'b'], np.arange(200), q, 0 * q, q * [20.0, 10.0])
    assert first_model_objection(samples, np.array([0.5, 1.0])) is None
    assert 'effort of b contradicts' in first_model_objection(samples, np.array([0.5, 4.0]))
    assert lost_gravity(samples, 5.0 * samples.tau, np.full(2, 0.1)) is not None
    assert lost_gravity(samples, 2.0 * samples.tau, np.full(2, 0.1)) is None


def test_two_jerks_are_no_broken_effort():
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (150, 2))
    gravity = q * [3.0, 10.0]
    tau = gravity + 0.1 * rng.standard_normal(q.shape)
    few, many = tau.copy(), tau.copy()
    few[:2, 0] += [-8.0, 8.0]
    many[:60, 0] += 8.0 * rng.choice([-1.0, 1.0], 60)
    for effort, is_broken in ((few, False), (many, True)):
        samples = JointSamples.single_run(['a', 'b'], np.arange(150), q, 0 * q + 0.1, effort)
        left = rms_without(samples, gravity)
        assert (first_model_objection(samples, left) is not None) == is_broken
    assert rms_without(replace(samples, tau=few), gravity) == pytest.approx([0.1, 0.1], rel=0.2)


def test_one_joint_alone_does_not_lose_its_gravity_to_a_payload():
    q = np.random.default_rng(0).uniform(-1, 1, (60, 3))
    noise, before = np.full(3, 0.1), q * [20.0, 8.0, 3.0]

    def judged(tau):
        tau = tau + noise * np.random.default_rng(1).standard_normal(tau.shape)
        samples = JointSamples.single_run(['a', 'b', 'c'], np.arange(60.0), q, 0 * q, tau)
        return dead_joint(samples, before, noise)

    assert judged(before) is None
    assert 'effort of b is' in judged(before * [1.0, 0.0, 1.0])
    # A payload that is taken off the last link takes torque off all.
    assert judged(before * [0.8, 0.6, 0.0]) is None
    assert judged(before * [0.5, 0.5, 0.5]) is None


@pytest.mark.parametrize('bad', [{'mass': 0.0}, {'reach': -1.0}, {'mass': float('inf')}])
def test_limits_must_be_positive(bad):
    with pytest.raises(OptionError, match='payload limits'):
        PayloadLimits(**bad)


def bent(model, angle):
    """Return a chain model whose axes point elsewhere, as one learned from too little motion."""
    turned = np.random.default_rng(0).uniform(-angle, angle, 14)
    chain = model.chain.moved(np.concatenate([turned, np.zeros(14)]))
    return GravityModel.from_energy(model.joints, 'chain', expand(chain), model.noise,
                                    model.coverage, {}, chain, model.uncertainty)


def test_a_model_that_still_changes_has_not_settled(base):
    case = recorded('multisine', 3, 60.0, 0.0, None, 'bare', np.random.default_rng(0))
    noise = np.full(7, 0.1)
    assert instability(base, case.samples, noise, lambda early: base) is None
    found = instability(bent(base, 0.3), case.samples, noise, lambda early: base)
    assert found is not None and 'has not converged' in found and 'N·m' in found
    parts = []
    instability(base, case.samples, noise, lambda part: parts.append(part) or base)
    first, last = parts
    assert len(first) == 0.85 * len(case.samples) and first.t[0] == case.samples.t[0]
    assert len(last) == 0.7 * len(case.samples) and last.t[-1] == case.samples.t[-1]
    # A model that its first part agrees with may still be contradicted by its last.
    found = instability(base, case.samples, noise,
                        lambda part: base if len(part) == 255 else bent(base, 0.3))
    assert 'the first 90 of 300 samples changed' in found

    def too_few(part):
        raise FitError('10 samples are too few')

    assert 'too few for a model' in instability(base, case.samples, noise, too_few)
