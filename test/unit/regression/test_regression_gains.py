"""Posterior, evidence and gains: against the normal distribution of the whole problem."""

from functools import cache

from bench.shared.regression_cases import (
    first_terms, linear_problem, motion_of_joints, NOISE, OwnGravity, with_torque)
from gravity_comp_ros.effects.registry import known_effect
from gravity_comp_ros.regression.candidates import candidates_of
from gravity_comp_ros.regression.design import Design, Pool
from gravity_comp_ros.regression.gains import (
    gain_of, inflation, log_share_allowed, Ranking, Score, score_of, shares_left)
from gravity_comp_ros.regression.posterior import leave_out, solve
from gravity_comp_ros.regression.term import is_consistent, uncorrected, with_children_of
from gravity_comp_ros.regression.uncertainty import law_covariances
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

SIGNED = ('torque_offset', 'torque_drift')
FRICTION = ('coulomb_friction', 'viscous_friction')
POSITIVE = (*FRICTION, 'joint_spring')
SHARED = OwnGravity(np.array([1.0, 3.0, -2.0, 0.5]))
# Noise of the model in N·m, above that of the data: then no score scatters more than the noise.
MODEL_NOISE = 3.0 * NOISE
PRECISION = np.array([MODEL_NOISE, 2.0 * MODEL_NOISE]) ** -2.0


def torque(q, qd, t):
    """Return gravity, friction on the first joint, and a spring on the second."""
    extra = np.column_stack([0.02 * np.tanh(qd[:, 0] / 0.005), 0.03 * (q[:, 1] - 0.2)])
    return SHARED.gravity(q) + extra


@cache
def case(seed, seconds=60.0):
    """Return design, factory, and the terms of two joints and of the arm, by name."""
    samples = with_torque(motion_of_joints(2, seed, seconds), torque, seed)
    _, design, factory = linear_problem(samples, SHARED)
    soft = known_effect('joint_flexibility')
    terms = [term for joint in range(2) for term in first_terms(factory, joint)]
    return design, factory, {t.key: t for t in (
        *terms, *(factory.term(soft, joint, {}) for joint in range(2)),
        factory.term(known_effect('tool_force'), None, {}))}


cases = given(st.integers(0, 5), st.sets(st.sampled_from(SIGNED)), st.integers(0, 1),
              st.sampled_from((*SIGNED, *POSITIVE, 'joint_flexibility', 'tool_force')))


@cases
def test_the_gain_is_the_evidence_of_the_whole_problem_with_the_term(seed, base, joint, name):
    design, _, terms = case(seed)
    term = terms[name, None if name == 'tool_force' else joint]
    others = tuple(terms[each, k] for k, each in enumerate(sorted(base)[:2])
                   if terms[each, k] is not term)
    before = solve(design, others, PRECISION)
    after = solve(design, (*others, term), PRECISION)
    difference = after.log_evidence - before.log_evidence
    assert gain_of(before, term) == pytest.approx(difference, rel=1e-6, abs=1e-5)
    scored = score_of(before, term)
    np.testing.assert_allclose(scored.mean, after.beta[after.at[term]], rtol=1e-5, atol=1e-8)
    # Conditioned to 0, a term is as if it were not there.
    without = after.without((term,))
    assert gain_of(without, term) == pytest.approx(difference, rel=1e-6, abs=1e-5)
    np.testing.assert_allclose(without.beta[:len(before.beta)], before.beta, atol=1e-8)
    np.testing.assert_allclose(without.squares, before.squares, rtol=1e-8)


def test_the_evidence_is_the_normal_density_of_the_data():
    """The data are N(0, diag(1 / precision) + X S X'), without coefficients."""
    design, _, terms = case(1, 6.0)
    names = [('torque_offset', 0), ('torque_offset', 1), ('torque_drift', 0), ('tool_force', None)]

    def density(selected):
        y, blocks, prior = [], [], [design.prior.root, *(np.diag(t.prior_std) for t in selected)]
        for j in range(2):
            columns = [design.x[j][:4]]
            for term in selected:
                here = j in term.joints(2)
                columns.append(design.weighted(j, term) if here else
                               np.zeros((term.n_columns, design.n_rows)))
            blocks.append(np.concatenate(columns).T)
            y.append(design.y[j])
        x = np.concatenate(blocks) @ block_diag(*prior)
        noise = np.repeat(1.0 / PRECISION, design.n_rows)
        return multivariate_normal(cov=np.diag(noise) + x @ x.T).logpdf(
            np.concatenate(y)) + sum(t.log_odds for t in selected)

    constant = solve(design, (), PRECISION).log_evidence - density([])
    for count in range(1, 5):
        selected = tuple(terms[key] for key in names[:count])
        estimates = solve(design, selected, PRECISION).log_evidence - density(selected)
        assert estimates == pytest.approx(constant, abs=1e-5)


def test_the_law_of_another_static_term_of_the_joint_may_have_the_shape_of_a_term():
    """The inflation is 1 + (error of the law x torque of the spring)^2 R / noise^2."""
    samples = with_torque(motion_of_joints(2, 1), lambda q, *_: SHARED.gravity(q) + [
        0.0, 1.0] * (q - 0.2), 1)
    problem, _, factory = linear_problem(samples, SHARED)
    design = Design(problem.rows, problem.y, problem.states.mean(SHARED.columns),
                    SHARED.prior(problem.scale), problem.weights, law_error=0.1)
    spring, offset, other, friction = (
        next(t for t in first_terms(factory, joint) if t.name == name) for name, joint in (
            ('joint_spring', 1), ('torque_offset', 1), ('torque_offset', 0),
            ('coulomb_friction', 1)))
    posterior = solve(design, (spring,), PRECISION)
    held = design.weighted(1, spring).T @ posterior.beta[posterior.at[spring]]
    expected = 1.0 + 0.1 ** 2 * (held ** 2).sum() * PRECISION[1]
    assert inflation(posterior, score_of(posterior, offset)) == pytest.approx(expected)
    assert expected > 1.5
    for term in (other, friction):
        assert inflation(posterior, score_of(posterior, term)) == 1.0


def test_a_positive_prior_is_the_normal_one_cut_at_zero():
    """One coefficient: the evidence is the integral over its allowed side."""
    design, _, terms = case(2)
    term = terms['coulomb_friction', 0]
    before, after = solve(design, (), PRECISION), solve(design, (term,), PRECISION)
    scored = score_of(before, term)
    m, u = scored.information[0, 0], scored.score[0]
    x = np.linspace(0.0, 8.0 * term.prior_std[0], 400001)
    prior = 2.0 * np.exp(-0.5 * (x / term.prior_std[0]) ** 2) / (
        term.prior_std[0] * np.sqrt(2.0 * np.pi))
    exponent = u * x - 0.5 * m * x ** 2
    integral = trapezoid(prior * np.exp(exponent - exponent.max()), x)
    expected = np.log(integral) + exponent.max() + term.log_odds
    assert after.log_evidence - before.log_evidence == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize('name', FRICTION)
def test_friction_is_not_negative(name):
    column = {'coulomb_friction': lambda qd: np.tanh(qd / 0.002),
              'viscous_friction': lambda qd: qd}[name]
    gains = {}
    for sign in (1.0, -1.0):
        samples = with_torque(motion_of_joints(2, 3), lambda q, qd, t, sign=sign: (
            SHARED.gravity(q) + sign * 0.5 * column(qd)))
        _, design, factory = linear_problem(samples, SHARED)
        term = first_terms(factory, 0, (name,))[0]
        gains[sign] = gain_of(solve(design, (), PRECISION), term)
    assert gains[1.0] > 50.0
    assert gains[-1.0] < 0.0


@pytest.mark.parametrize('seed', range(2))
def test_a_ranking_has_the_best_terms_first_and_its_bounds_are_bounds(seed):
    design, factory, _ = case(seed)
    effects = [known_effect(name) for name in (*SIGNED, *POSITIVE, 'torque_ripple')]
    candidates = candidates_of(factory, effects).of_joint[0]
    pool, posterior = Pool(design, [0], candidates), solve(design, (), PRECISION)
    ranking = Ranking(posterior, pool, range(len(candidates)), 3.0)
    gains = np.array([gain_of(posterior, term) for term in candidates])
    share = np.array([shared_odds(posterior, term) for term in candidates])
    upper = np.log(2.0) * np.array([t.positive.sum() for t in candidates])
    np.testing.assert_allclose(ranking.bounds, gains - share + upper, rtol=1e-6, atol=1e-6)
    assert (gains <= ranking.bounds + 1e-6).all()
    estimates = list(ranking)
    assert [gain for gain, _ in estimates] == sorted((gain for gain, _ in estimates), reverse=True)
    assert estimates[0][0] == pytest.approx(gains.max()) and estimates[0][0] > 3.0


def shared_odds(posterior, term):
    """Return the log evidence that a positive prior adds to a gain."""
    scored = score_of(posterior, term)
    return log_share_allowed(term, scored.mean,
                             scored.information + np.diag(term.prior_std ** -2.0))


def test_an_error_that_repeats_with_the_motion_has_a_smaller_gain():
    """An inflation above 1, from the scatter of the scores over blocks."""
    design, _, terms = case(0)
    exact = np.full(2, (0.2 * NOISE) ** -2.0)
    term = terms['joint_spring', 1]
    before, after = solve(design, (), exact), solve(design, (term,), exact)
    assert gain_of(before, term) < after.log_evidence - before.log_evidence


@given(st.integers(0, 5), st.integers(0, 10 ** 6), st.floats(0.05, 0.9))
def test_leaving_rows_out_is_solving_without_them(seed, draw, share):
    design, _, terms = case(seed)
    selected = tuple(terms[key] for key in (('coulomb_friction', 0), ('joint_spring', 1),
                                            ('joint_flexibility', 1)))
    out = np.random.default_rng(draw).random(design.n_rows) < share
    reduced = leave_out(solve(design, selected, PRECISION), out)
    again = Design(design.rows, (design.y / design.root).T,
                   np.stack([design.x[j][:4].T / design.root[j][:, None] for j in range(2)],
                            axis=1),
                   design.prior, (design.root ** 2).T * ~out[:, None])
    expected = solve(again, selected, PRECISION)
    np.testing.assert_allclose(reduced.beta, expected.beta, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(reduced.covariance, expected.covariance, rtol=1e-5, atol=1e-12)
    # The residual is that of the rows reduced out, which the coefficients do not depend on.
    for j in range(2):
        torque = solve(design, selected, PRECISION).torque(j, reduced.beta[reduced.places(j)])
        held_out = design.y[j] - torque
        np.testing.assert_allclose(reduced.residual(j), held_out[out], atol=1e-10)


@settings(max_examples=5)
@given(st.integers(0, 5), st.permutations(range(6)))
def test_the_order_of_terms_does_not_matter(seed, order):
    design, _, terms = case(seed)
    selected = list(terms.values())[:6]
    one = solve(design, tuple(selected), PRECISION)
    two = solve(design, tuple(selected[k] for k in order), PRECISION)
    assert two.log_evidence == pytest.approx(one.log_evidence, abs=1e-6)
    for term in selected:
        np.testing.assert_allclose(two.beta[two.at[term]], one.beta[one.at[term]], rtol=1e-6)
        np.testing.assert_allclose(two.std(term), one.std(term), rtol=1e-6)


def test_a_term_that_the_others_explain_has_no_gain():
    design, factory, terms = case(0)
    offset = terms['torque_offset', 0]
    twin = type('Twin', (type(offset.effect),), {'name': 'twin'})()
    same = factory.term(twin, 0, {})
    posterior = solve(design, (offset,), PRECISION)
    assert gain_of(posterior, same) < 0.0
    assert score_of(posterior, same).unabsorbed < 0.03
    assert score_of(solve(design, (), PRECISION), same).unabsorbed > 0.1


def test_a_coefficient_is_identified_by_what_all_other_columns_leave_of_its_column():
    # Two columns of lengths 2 and 3 at 30 degrees; a third column has half of the first one.
    columns = np.array([[2.0, 0.0], [3.0 * np.cos(np.pi / 6), 1.5]])
    own = columns @ columns.T
    np.testing.assert_allclose(shares_left(own, np.diag(own)), 0.5, rtol=1e-6)
    alone = Score(None, np.diag([1.0, 9.0]), np.zeros(2), np.zeros(2), np.diag([4.0, 9.0]))
    np.testing.assert_allclose(alone.identified, [0.5, 1.0], rtol=1e-6)
    none = Score(None, np.diag([1.0, 0.0]), np.zeros(2), np.zeros(2), np.diag([4.0, 0.0]))
    assert none.identified[1] < 1e-3


def test_the_error_of_a_law_changes_the_coefficients_as_draws_of_it_do():
    design, _, terms = case(0)
    selected = tuple(terms.values())
    posterior = solve(design, selected, PRECISION)
    rubbing = terms['coulomb_friction', 1]
    torque = rubbing.on(1) @ posterior.beta[posterior.at[rubbing]] * design.root[1]
    draws = np.random.default_rng(3).normal(size=(4000, design.n_rows))
    error = design.law_error * np.sqrt((torque ** 2).sum()) * draws
    score = np.zeros((len(draws), len(posterior.beta)))
    score[:, posterior.places(1)] = PRECISION[1] * error @ design.x[1][posterior.columns(1)].T
    std = (score @ posterior.covariance).std(axis=0)
    expected = np.sqrt(np.diag(np.tensordot(
        posterior.squares_of(rubbing), law_covariances(posterior), 1)))
    np.testing.assert_allclose(std, expected, rtol=0.1, atol=1e-9 * expected.max())


def test_a_column_that_is_a_sum_of_others_is_not_identified():
    columns = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 1e-7]])
    own = columns @ columns.T
    assert (shares_left(own, np.diag(own)) < 1e-4).all()
    negative = Score(None, np.diag([1.0, -1e-9]), np.zeros(2), np.zeros(2), np.eye(2))
    assert negative.identified[1] == 0.0
    # The moment about a vertical axis has no torque; its rounding seemed to be identified.
    z = np.random.default_rng(1).normal(size=(3, 50)) * np.array([[1.0], [1e-8], [2.0]])
    own = z @ z.T
    shares = shares_left(own, np.diag(own))
    assert shares[1] == 0.0 and shares[[0, 2]].min() > 0.8


def test_corrections_need_what_they_correct():
    _, factory, terms = case(0)
    coulomb, viscous = terms['coulomb_friction', 0], terms['viscous_friction', 0]
    drift = first_terms(factory, 0, ('friction_drift',))[0]
    assert is_consistent((coulomb, drift)) and is_consistent((viscous, drift))
    assert not is_consistent((drift,))
    assert not is_consistent((drift, terms['coulomb_friction', 1]))
    assert with_children_of((coulomb, viscous, drift), coulomb) == (viscous, drift)
    assert with_children_of((coulomb, drift), coulomb) == ()
    # A correction is removed before what it corrects, one of two corrected terms at any time.
    assert uncorrected((coulomb, drift)) == (drift,)
    assert uncorrected((coulomb, viscous, drift)) == (coulomb, viscous, drift)
