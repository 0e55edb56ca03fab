"""Plausibility tests of a new model: broken effort is refused, real payloads are accepted."""

from dataclasses import replace
import re

from bench.shared.broken_effort import intermittent_brake, KINDS
from bench.shared.campaign import campaign
from bench.shared.payload_samples import job_of, recorded
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.estimation.chain_of_model import as_chain, ChainOfModel
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.subset_stability import convergence_objection
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import expand
from gravity_comp_ros.node import acceptance, checks
from gravity_comp_ros.node.acceptance import (
    body_checks, gravity_present, joints_agree, reference_noise)
from gravity_comp_ros.node.checks import FAULTS, FIT, Job
from gravity_comp_ros.node.epoch import Rows
from gravity_comp_ros.node.hypotheses import Window
from gravity_comp_ros.node.jobs import outliers_of_change, run_fit
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload
from gravity_comp_ros.simulation.motions import multisine
import numpy as np
import pytest


@pytest.fixture(scope='module')
def base():
    bare = recorded('eq17', 0, 100.0, 0.0, None, 'bare', np.random.default_rng(5))
    return fit(bare.samples, FitOptions(formulation='chain')).model


def corrupted(name, n=100, seed=1):
    rng = np.random.default_rng(seed)
    case = recorded('eq17', seed, n / 5.0, 50.0, Payload(2.0), name, rng)
    s = case.samples
    return replace(case, samples=JointSamples.single_run(
        s.names, s.t, s.q, s.qd, KINDS[name](s.tau, rng)))


# Each takes seconds of processor time; bench/node_faults has the others.
@pytest.mark.parametrize('name', [
    'dead elbow', 'flipped shoulder', *campaign('drives off', 'all flipped')])
def test_broken_effort_is_refused(name, base, geometry):
    result = run_fit(job_of(corrupted(name), base, geometry))
    assert result.fault and not result.accepted and result.fault in result.reason


@pytest.mark.parametrize('mass, centre', [(0.3, (0.0, 0.0, 0.1)), (5.0, (0.12, -0.1, 0.1))])
def test_a_real_payload_is_accepted_within_twenty_seconds(mass, centre, base, geometry):
    case = recorded('eq17', 0, 20.0, 80.0, Payload(mass, centre), 'real',
                    np.random.default_rng(2))
    outcome = run_fit(job_of(case, base, geometry))
    assert outcome.accepted, outcome.reason
    assert np.abs(outcome.model.predict(case.later) - case.truth).max() < 0.5


@pytest.mark.parametrize('seconds, seed', [
    (8.0, 2), *campaign((20.0, 1), (20.0, 4))])
def test_samples_with_an_intermittent_brake_are_left_out(seconds, seed, base):
    rng = np.random.default_rng(seed)
    case = recorded('eq17', seed, seconds, 60.0 + 23.0 * seed, Payload(2.0), 'brake', rng)
    samples = replace(case.samples, tau=intermittent_brake(case.samples.tau, rng))
    result = run_fit(job_of(replace(case, samples=samples), base))
    assert result.accepted, result.reason
    assert result.outliers and sum(result.outliers.values()) < 0.2 * len(samples)
    assert np.abs(result.model.predict(case.later) - case.truth).max() < 0.5
    clean = run_fit(job_of(case, base))
    assert not clean.outliers


def test_a_lasting_fault_of_a_joint_is_no_outlier(base):
    samples = recorded('eq17', 0, 20.0, 80.0, Payload(2.0), '', np.random.default_rng(2)).samples
    tau = samples.tau.copy()
    tau[40:, 1] = 0.0
    assert not outliers_of_change(replace(samples, tau=tau), base).any()


def tables_of(base, change=None, scaled=(), limits=Parameters(), geometry=None, payload=None):
    """
    Return the tables of twenty seconds with 0.1 N·m of noise.

    :param change: added moments of links in N·m, in the direction of their own.
    :param scaled: joints and the gain of their effort.
    """
    samples = recorded('eq17', 0, 20.0, 30.0, payload, '', np.random.default_rng(0)).samples
    if change is not None:
        moments = np.zeros((7, 2))
        for joint, value in change.items():
            own = base.chain.moments[joint]
            moments[joint] = value * own / np.linalg.norm(own)
        moved = base.chain.moved(np.concatenate([np.zeros(14), moments.ravel()]))
        noise = 0.1 * np.random.default_rng(1).standard_normal((100, 7))
        samples = replace(samples, tau=moved.torque(samples.q) + noise)
    tau = samples.tau.copy()
    for joint, gain in scaled:
        tau[:, joint] *= gain
    noise = np.full(7, 0.1)
    return Window(replace(samples, tau=tau), 0.0 * tau, base, base, noise, noise, limits,
                  geometry).tables()


def refusals(every_table):
    """Return name and text of each check that did not pass."""
    return {check.name: check.text for check in
            body_checks(every_table) if not check.passed}


LIGHT, HEAVY = {1: 10.0, 3: 9.0}, {1: 60.0, 3: 50.0}
FAR = Payload(3.0, (0.0, 0.0, 0.4))


CARRIED = [{'payload': Payload(mass, (0.1, -0.05, 0.1))} for mass in (0.3, 5.0)]


@pytest.mark.parametrize('known, case, limits, reason', [
    *((known, case, {}, None) for known in (False, True) for case in ({}, *CARRIED)),
    (False, {'change': LIGHT}, {}, None), (False, {'change': HEAVY}, {}, None),
    (False, {'change': HEAVY}, {'max_payload': 5.0}, (checks.WITHIN_LIMITS, 'max_payload 5 kg')),
    (False, {'scaled': [(joint, 2.0) for joint in range(7)]}, {'max_payload': 100.0},
     (checks.NO_FAULT, 'all joints is 2 times')),
    # Known axes bound mass and reach.
    (True, {'payload': FAR}, {}, None),
    (True, {'payload': FAR}, {'max_payload': 2.0}, (checks.WITHIN_LIMITS, 'max_payload is 2 kg')),
    (True, {'payload': FAR}, {'max_payload_reach': 0.2},
     (checks.WITHIN_LIMITS, 'max_payload_reach'))])
def test_a_change_is_a_body_within_the_limits_or_refused(base, geometry, known, case, limits,
                                                         reason):
    axes = geometry if known else None
    reasons = refusals(tables_of(as_chain(base, axes), limits=Parameters(**limits), geometry=axes,
                                 **case))
    assert not reasons if reason is None else reason[1] in reasons[reason[0]]


# Each joint, gain and kind of axes once with each other; `make bench` has all.
@pytest.mark.parametrize('known, joint, gain', [
    (False, 1, 0.0), (False, 3, -1.0), (False, 5, 0.5),
    (True, 1, -1.0), (True, 3, 0.5), (True, 5, 0.0), *campaign(
        (False, 1, -1.0), (False, 1, 0.5), (False, 3, 0.0), (False, 3, 0.5), (False, 5, 0.0),
        (False, 5, -1.0), (True, 1, 0.0), (True, 1, 0.5), (True, 3, 0.0), (True, 3, -1.0),
        (True, 5, -1.0), (True, 5, 0.5))])
def test_the_faulty_joint_is_named(base, geometry, joint, gain, known):
    axes = geometry if known else None
    reasons = refusals(tables_of(as_chain(base, axes), scaled=[(joint, gain)], geometry=axes))
    match = re.search(r'of iiwa_joint_(\d) is (\S+) times', reasons[checks.NO_FAULT])
    assert int(match[1]) == joint + 1 and float(match[2]) == pytest.approx(gain, abs=0.02)


@pytest.mark.parametrize('gain', [0.0, 0.5])
def test_a_faulty_joint_measures_a_body_with_its_gain(base, geometry, gain):
    """The payload has most of the torque of the last joint but one."""
    payload = Payload(5.0, (0.1, -0.05, 0.2))
    every = tables_of(as_chain(base, geometry), scaled=[(5, gain)], geometry=geometry,
                      payload=payload)
    assert 1.0 + every[0].gain_of(5).mean[0] == pytest.approx(gain, abs=0.02)
    assert 'iiwa_joint_6' in refusals(every)[checks.NO_FAULT]


@pytest.mark.parametrize('name', ['saturated', 'swapped'])
def test_a_joint_whose_fault_is_no_gain_is_named(name, base):
    """The shoulder and the elbow are saturated or swapped, and no gain explains the effort."""
    result = run_fit(job_of(corrupted(name), base))
    assert 'no payload explains' in result.fault
    assert 'most likely the effort of iiwa_joint_4 is frozen, saturated or' in result.fault


def test_a_potential_model_of_a_serial_arm_is_a_chain(base):
    bare = recorded('eq17', 0, 60.0, 0.0, None, 'bare', np.random.default_rng(5)).samples
    model = fit(bare, FitOptions(formulation='potential')).model
    chain = as_chain(model)
    assert chain.formulation == 'chain'
    assert np.abs(chain.predict(bare.q) - model.predict(bare.q)).max() < 0.3
    no_chain = replace(model, covariance=None)
    assert as_chain(no_chain) is None
    # Any part of the model may change its chain.
    chains = ChainOfModel()
    assert chains.of(no_chain, None) is None and chains.of(model, None) is not None
    assert chains.of(model, None) is chains.of(model, None)


def test_reference_noise_is_the_larger_of_earlier_and_present_noise():
    rng = np.random.default_rng(0)
    t = 0.2 * np.arange(400)
    q = np.stack([np.sin(0.1 * t), np.cos(0.1 * t)], axis=1)
    tau = 20.0 * q + np.array([0.05, 1.0]) * rng.standard_normal(q.shape)
    samples = JointSamples.single_run(['a', 'b'], t, q, 0 * q, tau)
    result = reference_noise(np.full(2, 0.1), samples, tau - 19.0 * q)
    assert result[0] == 0.1 and result[1] == pytest.approx(1.0, rel=0.2)


def test_a_first_model_must_explain_every_joint():
    q = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    samples = JointSamples.single_run(['a', 'b'], np.arange(200), q, 0 * q, q * [20.0, 10.0])
    assert joints_agree(samples, np.array([0.5, 1.0])).passed
    refusal = joints_agree(samples, np.array([0.5, 4.0]))
    assert not refusal.passed and 'effort of b contradicts' in refusal.text
    assert not gravity_present(samples, 5.0 * samples.tau, np.full(2, 0.1)).passed
    assert gravity_present(samples, 2.0 * samples.tau, np.full(2, 0.1)).passed


def with_wrong_axes(model, angle):
    """Return a chain model with wrong axes, as after a fit to too little motion."""
    turned = np.random.default_rng(0).uniform(-angle, angle, 14)
    chain = model.chain.moved(np.concatenate([turned, np.zeros(14)]))
    return GravityModel.from_energy(model.joints, 'chain', expand(chain), model.noise,
                                    model.coverage, {}, chain, model.covariance)


def test_a_model_that_changes_with_its_samples_has_not_converged(base):
    case = recorded('multisine', 3, 60.0, 0.0, None, 'bare', np.random.default_rng(0))
    noise = np.full(7, 0.1)
    assert convergence_objection(base, case.samples, noise, lambda early: base) is None
    result = convergence_objection(with_wrong_axes(base, 0.6), case.samples, noise,
                                   lambda early: base)
    assert result is not None and 'has not converged' in result and 'N·m' in result
    parts = []
    convergence_objection(base, case.samples, noise, lambda part: parts.append(part) or base)
    first, last = parts
    assert len(first) == 0.85 * len(case.samples) and first.t[0] == case.samples.t[0]
    assert len(last) == 0.7 * len(case.samples) and last.t[-1] == case.samples.t[-1]
    # A fit to the first part may agree with the model, and one to the last part contradict it.
    result = convergence_objection(
        base, case.samples, noise,
        lambda part: base if len(part) == 255 else with_wrong_axes(base, 0.6))
    assert 'the first 90 of 300 samples changed' in result

    def too_few(part):
        raise FitError('10 samples are too few')

    assert 'too few for a model' in convergence_objection(base, case.samples, noise, too_few)


def job():
    """Return a minute of slow motion of an iiwa."""
    arm = iiwa7()
    motion = multisine(arm.lower, arm.upper, np.full(7, 0.4), 3, duration=60.0, rate=5.0)
    tau = gravity_torque(arm, motion.q) + 0.05 * np.random.default_rng(0).standard_normal(
        motion.q.shape)
    samples = JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)
    return Job(FIT, Rows(samples, np.arange(len(samples)) // 5 % 4 == 3))


def test_a_gain_that_the_last_samples_do_not_show_is_no_fault_of_the_effort(monkeypatch):
    """The first model waits for more motion, and the samples are kept."""
    fact = Fact(Kind.EFFORT_GAIN, ('iiwa_joint_4',), 'gains disagree', Action.REFUSED)
    whole = job()
    monkeypatch.setattr(acceptance, '_facts_of_arm', lambda job, samples:
                        [fact] if len(samples) == len(whole.rows) else [])
    _, check = acceptance.first_samples(whole)
    assert not check.passed and check.name == checks.CONVERGED
    assert check.name not in FAULTS
