"""The regression as a whole: a pendulum and two links by hand, laws, and pure noise."""

from dataclasses import replace

from bench.shared.campaign import campaign
from bench.shared.regression_cases import (
    chain_of_two_links, EFFECTS, motion_of_joints, NOISE, OwnGravity, two_links, with_torque)
from bench.shared.serial_arms import planar_2r
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.friction import ViscousFriction
from gravity_comp_ros.effects.motion_direction import presliding_state
from gravity_comp_ros.effects.registry import known_effect, library_effects
from gravity_comp_ros.regression.alternatives import alternatives
from gravity_comp_ros.regression.engine import _search as search_of, regress
from gravity_comp_ros.regression.exchanges import _again as select_again
from gravity_comp_ros.regression.linear import gauss_newton, Linear, with_common_terms
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

SMALL = tuple(known_effect(name) for name in EFFECTS)
EVERY = tuple(library_effects().values())


def pendulums(n, samples, effects=SMALL, **given):
    """Return the regression of joints that do not load each other."""
    return regress(Problem.of(samples), OwnGravity(np.zeros(2 * n)), effects, **given)


def coefficients(result):
    """Return mean and standard deviation of the coefficients of each term."""
    posterior = result.posterior
    return {t.key: (posterior.beta[posterior.at[t]], posterior.std(t)) for t in result.terms}


def rich(q, qd, t):
    """Return the torque of three joints: gravity, friction on one, a spring on another."""
    gravity = 4.0 * np.sin(q) + np.array([1.0, -3.0, 0.5]) * np.cos(q)
    gravity[:, 0] += 0.6 * np.tanh(qd[:, 0] / 0.005) + 1.5 * qd[:, 0]
    gravity[:, 2] += 2.0 * (q[:, 2] - 0.8)
    return gravity


FOUND = {('coulomb_friction', 0), ('viscous_friction', 0), ('joint_spring', 2)}


@pytest.mark.parametrize('seed', [0, *campaign(1)])
def test_a_pendulum_by_hand(seed):
    samples = with_torque(motion_of_joints(1, seed, rate=10.0), lambda q, qd, t: (
        4.0 * np.sin(q) - 1.0 * np.cos(q) + 0.5 * np.tanh(qd / 0.005) + 1.2 * qd), seed)
    result = pendulums(1, samples, EVERY)
    estimates = coefficients(result)
    assert set(estimates) == {('coulomb_friction', 0), ('viscous_friction', 0)}
    for key, truth in ((('coulomb_friction', 0), 0.5), (('viscous_friction', 0), 1.2)):
        value, std = estimates[key]
        assert abs(value[0] - truth) < 5.0 * std[0] and std[0] < 0.1 * truth
    np.testing.assert_allclose(result.shared.weights, [4.0, -1.0], atol=0.05)
    assert result.noise[0] == pytest.approx(NOISE, rel=0.1)
    assert result.converged


def test_a_selected_start_has_one_pass_at_least():
    samples = with_torque(motion_of_joints(1, 0, rate=10.0), lambda q, qd, t: np.sin(q), 0)
    problem = Problem.of(samples, options=EngineOptions(passes=1))
    assert regress(problem, OwnGravity(np.zeros(2)), SMALL, is_selected=True).converged


@pytest.mark.parametrize('seed', [0, *campaign(1, 2, 3, 4)])
def test_a_cable_between_the_compared_starts_is_one_term(seed):
    # At none of the starts and orders that are compared.
    start = float(np.random.default_rng(seed).uniform(-0.4, 0.4))

    def torque(q, qd, t):
        cable = 3.0 * np.maximum(q - start, 0.0) ** 1.3
        return 4.0 * np.sin(q) - np.cos(q) + 0.5 * np.tanh(qd / 0.005) + cable

    samples = with_torque(motion_of_joints(1, seed, rate=10.0), torque, seed)
    terms = {term.key: term for term in pendulums(1, samples, EVERY).terms}
    assert set(terms) == {('coulomb_friction', 0), ('cable_stiffness', 0)}
    cable = terms['cable_stiffness', 0]
    assert cable.setting['start'] == pytest.approx(start, abs=0.05)


def test_the_only_term_of_a_joint_with_unexplained_torque_is_selected_again():
    # At a setting one friction effect resembles two, and neither is better in its place.
    def torque(q, qd, t):
        gravity, direction = 3.0 * np.sin(q) + 15.0 * np.cos(q), np.tanh(qd / 0.005)
        return gravity + (0.4 + 0.05 * np.abs(gravity)) * direction

    problem = Problem.of(with_torque(motion_of_joints(1, 0, rate=10.0), torque, 0))
    shared = OwnGravity(np.array([3.0, 15.0]))
    factory = problem.factory(shared)
    one = factory.term(known_effect('load_dependent_friction'), 0,
                             {'friction': 6.5, 'width': 0.005})
    fit = Linear.at(problem, shared, factory, (one,), problem.weights)
    search = search_of(fit, EVERY, frozenset(), print)
    before = search.posterior.log_evidence
    assert select_again(search) and search.posterior.log_evidence > before + 10.0
    assert {'coulomb_friction', 'load_dependent_friction'} <= {t.name for t in search.terms}


def test_each_side_of_a_cable_is_refined_as_an_alternative():
    # Refinement does not change the side.
    def torque(q, qd, t):
        return 4.0 * np.sin(q) - np.cos(q) - 2.0 * np.maximum(-(q + 0.35), 0.0)

    problem = Problem.of(with_torque(motion_of_joints(1, 0, rate=10.0), torque, 0))
    shared = OwnGravity(np.array([4.0, -1.0]))
    factory = problem.factory(shared)
    ripple = factory.term(known_effect('torque_ripple'), 0, {'k': 4.0, 'harmonics': 4.0})
    fit = Linear.at(problem, shared, factory, (ripple,), problem.weights)
    cables = [each for each in alternatives(search_of(fit, EVERY, frozenset(), print), ripple)
              if each.term.name == 'cable_stiffness']
    assert len({each.term.setting['side'] for each in cables}) >= 2
    assert cables[0].term.setting['start'] == pytest.approx(-0.35, abs=0.02)


def test_a_ripple_that_resembles_a_cable_is_replaced(seed=5):
    # The cable at each of the compared starts is far worse than the refined ripple.
    parts = [replace(p, q=0.25 * p.q, qd=0.25 * p.qd)
             for p in motion_of_joints(1, seed, rate=10.0)]
    low, high = min(p.q.min() for p in parts), max(p.q.max() for p in parts)
    start = low + (high - low) * float(np.random.default_rng(seed).uniform(0.3, 0.7))

    def torque(q, qd, t):
        return 4.0 * np.sin(q) - np.cos(q) + 3.0 * np.maximum(q - start, 0.0)

    samples = with_torque(parts, torque, seed, 0.03)
    ripple = pendulums(1, samples, (known_effect('torque_ripple'),)).terms
    assert [term.name for term in ripple] == ['torque_ripple']
    (cable,) = pendulums(1, samples, EVERY, start=ripple, is_selected=True).terms
    assert cable.name == 'cable_stiffness'
    assert cable.setting['start'] == pytest.approx(start, abs=0.01)


@pytest.mark.parametrize('seed', [0, *campaign(1, 2)])
def test_a_term_that_corrects_the_poor_setting_of_another_is_removed(seed):
    def torque(q, qd, t):
        z = presliding_state(q[:, 0], 3e-4)[:, None]
        return 4.0 * np.sin(q) - np.cos(q) + 0.5 * z * (1.0 + 0.3 * np.exp(-(qd / 0.05) ** 2))

    problem = Problem.of(with_torque(motion_of_joints(1, seed, rate=50.0), torque, seed))
    shared = OwnGravity(np.array([4.0, -1.0]))
    start = [problem.factory(shared).term(known_effect(name), 0, setting) for name, setting in (
        ('coulomb_friction', {'distance': 3e-4}),
        ('stribeck_friction', {'speed': 0.05, 'width': 0.002}),
        ('presliding_hysteresis', {'distance': 1e-5}))]
    terms = {t.name: t.setting for t in regress(problem, shared, EVERY, start).terms}
    assert set(terms) == {'coulomb_friction', 'stribeck_friction'}
    assert terms['stribeck_friction']['distance'] == pytest.approx(3e-4, rel=0.5)


@pytest.mark.parametrize('seed', [0, *campaign(1, 2)])
def test_the_friction_effects_of_a_joint_have_one_law(seed):
    def torque(q, qd, t):
        z = presliding_state(q[:, 0], 6e-4)[:, None]
        return 4.0 * np.sin(q) - np.cos(q) + z * (0.5 + 0.3 * np.exp(-(qd / 0.05) ** 2))

    samples = with_torque(motion_of_joints(1, seed, rate=50.0), torque, seed)
    terms = {term.name: term for term in pendulums(1, samples, EVERY).terms}
    assert set(terms) == {'coulomb_friction', 'stribeck_friction'}
    assert terms['stribeck_friction'].common == terms['coulomb_friction'].common
    assert terms['coulomb_friction'].setting['distance'] == pytest.approx(6e-4, rel=0.3)


def test_an_offset_of_one_way_motion_may_be_friction_of_any_size():
    t = np.arange(0.0, 60.0, 0.05)
    qd = 0.1 + 0.05 * np.sin(0.7 * t)
    q = np.cumsum(qd) * 0.05
    # As Coulomb friction so large a torque is improbable, but this motion does not test its size.
    tau = 4.0 * np.sin(q) - np.cos(q) + 6.0 + NOISE * np.random.default_rng(0).normal(size=len(t))
    result = pendulums(1, JointSamples.single_run(
        ('joint_1',), t, q[:, None], qd[:, None], tau[:, None]), EVERY)
    assert [term.key for term in result.terms] == [('torque_offset', 0)]
    assert ('coulomb_friction', 0) in result.alternatives['torque_offset', 0]


@pytest.mark.parametrize('seed', [0, *campaign(1)])
def test_two_links_by_hand(seed):
    def friction(q, qd, t):
        return np.column_stack([0.4 * np.tanh(qd[:, 0] / 0.005), 0.8 * (q[:, 1] - 0.5)])

    samples = two_links(seed, friction)
    result = regress(Problem.of(samples), UnknownLengths.of(chain_of_two_links()), SMALL)
    estimates = coefficients(result)
    assert set(estimates) == {('coulomb_friction', 0), ('joint_spring', 1)}
    assert estimates['coulomb_friction', 0][0][0] == pytest.approx(0.4, abs=0.03)
    stiffness, std = (x[0] for x in estimates['joint_spring', 1])
    assert abs(stiffness - 0.8) < 5.0 * std
    q = np.random.default_rng(1).uniform(samples.q.min(axis=0), samples.q.max(axis=0), (200, 2))
    # The constant of a spring, or an offset, is a part of the held-out error of gravity alone.
    total = result.shared.gravity(q)
    term = next(t for t in result.terms if t.name == 'joint_spring')
    total[:, 1] += (np.column_stack([q[:, 1] - term.setting['centre'], np.ones(200)])
                    @ estimates['joint_spring', 1][0])
    truth = planar_2r(q) + np.column_stack([np.zeros(200), 0.8 * (q[:, 1] - 0.5)])
    assert np.abs(total - truth).max() < 0.12, np.abs(total - truth).max()


def test_the_problem_is_linearised_at_its_own_estimate():
    start = with_common_terms(Problem.of(two_links(0)), UnknownLengths.of(chain_of_two_links()),
                              SMALL)
    for fit in (start, start.moved(1.0), gauss_newton(start)[0]):
        columns = fit.problem.states.mean(fit.shared.columns)
        for j, (x, root) in enumerate(zip(fit.posterior.design.x, fit.posterior.design.root)):
            np.testing.assert_allclose(x[:columns.shape[2]], columns[:, j].T * root, atol=1e-9)


@settings(max_examples=2)
@given(st.integers(0, 20), st.permutations(range(3)))
def test_the_order_of_joints_does_not_matter(seed, order):
    samples = with_torque(motion_of_joints(3, seed), rich, seed)
    order = list(order)
    moved = samples.joints([samples.names[k] for k in order])
    one, two = pendulums(3, samples), pendulums(3, moved)
    assert {(name, order[joint]) for name, joint in coefficients(two)} == set(coefficients(one))
    assert FOUND <= set(coefficients(one))
    for (name, joint), (value, std) in coefficients(two).items():
        expected = coefficients(one)[name, order[joint]]
        np.testing.assert_allclose(value, expected[0], rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(std, expected[1], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(two.noise, one.noise[order], rtol=1e-5)


@settings(max_examples=2)
@given(st.integers(0, 20), st.floats(1e-3, 1e3))
def test_units_of_torque_scale_the_coefficients_and_leave_the_terms(seed, factor):
    samples = with_torque(motion_of_joints(3, seed), rich, seed)
    one = pendulums(3, samples)
    two = pendulums(3, replace(samples, tau=factor * samples.tau))
    assert [(t.key, t.setting) for t in two.terms] == [(t.key, t.setting) for t in one.terms]
    np.testing.assert_allclose(two.posterior.beta, factor * one.posterior.beta, rtol=1e-5,
                               atol=1e-7 * factor)
    np.testing.assert_allclose(two.noise, factor * one.noise, rtol=1e-6)
    for key, gain in one.gains.items():
        assert two.gains[key] == pytest.approx(gain, rel=1e-4, abs=1e-4)


def test_a_collinear_term_is_ambiguous_with_the_chosen_one():
    twin = type('Twin', (ViscousFriction,), {'name': 'twin'})()
    samples = with_torque(motion_of_joints(1, 0), lambda q, qd, t: (
        4.0 * np.sin(q) + 1.2 * qd), 0)
    result = pendulums(1, samples, (*SMALL, twin))
    (chosen, others), = result.alternatives.items()
    assert {chosen, *others} == {('viscous_friction', 0), ('twin', 0)}
    alone = pendulums(1, samples)
    assert alone.alternatives == {('viscous_friction', 0): ()}


def test_negative_friction_is_not_selected():
    samples = with_torque(motion_of_joints(1, 0), lambda q, qd, t: (
        4.0 * np.sin(q) - 0.5 * np.tanh(qd / 0.002)), 0)
    result = pendulums(1, samples, (known_effect('coulomb_friction'),
                                    known_effect('viscous_friction')))
    assert not result.terms
    assert result.noise[0] > 0.2


def test_forced_terms_stay_without_a_gain():
    samples = with_torque(motion_of_joints(1, 1), lambda q, qd, t: 4.0 * np.sin(q), 1)
    free = pendulums(1, samples)
    assert not free.terms
    offset = free.candidates.of_joint[0]
    term = next(t for t in offset if t.name == 'torque_offset')
    kept = pendulums(1, samples, start=[term], forced=frozenset([term.key]))
    assert [t.key for t in kept.terms] == [term.key]
    value, std = coefficients(kept)[term.key]
    assert abs(value[0]) < 5.0 * std[0]


def test_spikes_do_not_move_the_coefficients():
    samples = with_torque(motion_of_joints(1, 4), lambda q, qd, t: (
        4.0 * np.sin(q) + 0.5 * np.tanh(qd / 0.005)), 4)
    tau = samples.tau.copy()
    hit = np.random.default_rng(0).random(len(tau)) < 0.003
    tau[hit] += 30.0
    clean, spiky = pendulums(1, samples), pendulums(1, replace(samples, tau=tau))
    key = 'coulomb_friction', 0
    assert coefficients(spiky)[key][0][0] == pytest.approx(coefficients(clean)[key][0][0],
                                                           abs=0.05)
    np.testing.assert_allclose(spiky.shared.weights, clean.shared.weights, atol=0.1)


@pytest.mark.parametrize('arm', ['pendulum', *campaign('without gravity')])
def test_nothing_is_found_in_noise(arm):
    """At upper 1 of 50 joints has a term; the odds of `min_gain` allow 1 of 20."""
    size = 4.0 if arm == 'pendulum' else 0.0
    false = []
    for seed in range(5):
        parts = motion_of_joints(10, seed, 40.0, 10.0, runs=1)
        samples = with_torque(parts, lambda q, qd, t: size * np.sin(q + 0.3), seed)
        false += [(seed, key) for key in coefficients(pendulums(10, samples, EVERY))]
    assert len(false) <= 1, false


def test_intervals_contain_a_term_that_is_too_small_to_be_selected():
    """Viscous friction of at most 0.015 N·m, a third of the noise, is in the Coulomb friction."""
    covered = []
    for seed in range(2):
        samples = with_torque(motion_of_joints(10, seed, 40.0, 10.0, runs=1), lambda q, qd, t: (
            4.0 * np.sin(q) + 0.5 * np.tanh(qd / 0.005) + 0.15 * qd), seed)
        result = pendulums(10, samples)
        estimates = coefficients(result)
        for joint in range(10):
            key = 'coulomb_friction', joint
            if ('viscous_friction', joint) not in estimates:
                std = result.uncertainty.stds[key][0]
                covered.append(abs(estimates[key][0][0] - 0.5) < 1.96 * std)
    assert len(covered) >= 5 and np.mean(covered) > 0.8


def test_published_intervals_cover():
    """Of 95 % intervals of Coulomb friction in 10 recordings, at least 90 % cover."""
    covered = []
    for seed in range(10):
        samples = with_torque(motion_of_joints(1, seed, runs=1), lambda q, qd, t: (
            4.0 * np.sin(q) + 0.5 * np.tanh(qd / 0.005)), seed)
        result = pendulums(1, samples, (known_effect('coulomb_friction'),))
        value, std = coefficients(result)['coulomb_friction', 0]
        covered.append(abs(value[0] - 0.5) < 1.96 * std[0])
    assert np.mean(covered) >= 0.9


def test_runs_of_different_length_are_one_problem():
    parts = motion_of_joints(1, 5)
    short = JointSamples.single_run(parts[0].names, parts[0].t[:5], parts[0].q[:5],
                                    parts[0].qd[:5], parts[0].tau[:5])
    samples = with_torque([*parts, short], lambda q, qd, t: 4.0 * np.sin(q), 5)
    assert concatenate([samples]).n_runs == 3
    np.testing.assert_allclose(pendulums(1, samples).shared.weights, [4.0, 0.0], atol=0.05)
