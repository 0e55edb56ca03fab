"""Planned motion and its expected results on an arm of known gravity."""

from dataclasses import replace

from gravity_comp_ros.diagnosis.findings import Diagnosis, Estimate, Finding, JointReport
from gravity_comp_ros.diagnosis.options import MIN_UNABSORBED
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.planning import plan, PlanOptions, Target
from gravity_comp_ros.planning.context import DesignContext, DesignProblem, Hypothesis
from gravity_comp_ros.planning.criterion import effect_score, EffectScore, power
from gravity_comp_ros.planning.targets import design_problem, observed_separation, open_targets
from hypothesis import given, settings, strategies
import numpy as np
from planning_arm import CHAIN, model, NAMES, NOISE, one_way
import pytest


def test_friction_of_a_joint_that_moved_in_one_direction():
    planned = plan(one_way(0), model(), [Target('coulomb_friction', 'elbow')], PlanOptions(15.0))
    (expected,) = planned.expectations
    assert expected.chance_before < 0.01 and expected.chance > 0.95
    assert all('elbow' in part.joints for part in planned.parts)
    assert any('coulomb_friction:elbow' in part.settles for part in planned.parts)
    q, qd = planned.trajectory.q, planned.trajectory.qd
    assert qd[:, 1].min() < -0.1 and qd[:, 1].max() > 0.1
    # The other joints move only between postures.
    assert np.ptp(q[:, 1]) > 0.1


def test_the_interval_is_the_scatter_of_repeated_recordings():
    old = one_way(0)
    planned = plan(old, model(), [Target('coulomb_friction', 'elbow')], PlanOptions(15.0))
    motion = planned.trajectory
    # Coulomb and viscous friction, offset, inertia and linearised gravity, in both recordings.
    qd = np.vstack([old.qd, motion.qd])[:, 1]
    bend = np.vstack([np.gradient(old.qd, 0.02, axis=0), motion.qdd])
    gravity = CHAIN.jacobian(np.vstack([old.q, motion.q]))[2:, 1].T
    columns = np.column_stack([np.tanh(qd / 0.002), qd, np.ones(len(qd)), bend, gravity])
    rng = np.random.default_rng(0)
    tau = NOISE * rng.normal(size=(400, len(columns)))
    scatter = (tau @ np.linalg.pinv(columns, rcond=1e-9).T)[:, 0].std()
    width, unit = planned.expectations[0].half_width['F_c']
    assert unit == 'N·m' and 0.8 * scatter < width / 1.96 < 1.25 * scatter


def test_the_alternative_determines_the_motion():
    # Load friction is distinguished from Coulomb friction by a change of load only.
    target = Target('load_dependent_friction', 'elbow', ('coulomb_friction',))
    planned = plan(one_way(0), model(), [target], PlanOptions(20.0))
    (expected,) = planned.expectations
    assert expected.closest_alternative in ('coulomb_friction', '', 'torque_offset')
    load = np.abs(CHAIN.torque(planned.trajectory.q)[:, 1])
    moving = np.abs(planned.trajectory.qd[:, 1]) > 0.02
    assert np.ptp(load[moving]) > 0.3


@settings(max_examples=50, deadline=None)
@given(strategies.integers(0, 10_000))
def test_a_score_is_that_of_least_squares(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(40, 6))  # 3 nuisance terms, the target, an alternative of two columns
    size = np.array([rng.uniform(0.5, 2.0)])
    score = effect_score(x.T @ x, np.full(3, 1e-9), (1, 2), size)
    y = x[:, 3] * size[0]
    residual = [np.sqrt(np.linalg.lstsq(x[:, keep], y, rcond=None)[1][0])
                for keep in ([0, 1, 2], [0, 1, 2, 4, 5])]
    assert score.separation == pytest.approx(min(residual), rel=1e-5)
    assert score.closest == (None if residual[0] <= residual[1] else 0)
    columns = x[:, [0, 1, 2, 3]]
    assert score.std[0] == pytest.approx(
        np.sqrt(np.linalg.inv(columns.T @ columns)[3, 3]), rel=1e-5)
    # More data never reduce the separation.
    more = x.T @ x + np.diag(rng.uniform(0.0, 1.0, 6))
    better = effect_score(more, np.full(3, 1e-9), (1, 2), size)
    assert better.separation >= score.separation * (1 - 1e-9)


def test_a_collinear_column_has_no_information():
    x = np.random.default_rng(0).normal(size=(40, 2))
    x = np.column_stack([x, x[:, 1], x[:, 0]])
    score = effect_score(x.T @ x, np.full(2, 1e-9), (1, 1), np.ones(1))
    assert score.separation < 1e-2 and np.isinf(score.std[0])
    assert power(score.separation) < 1e-3


def test_the_information_of_other_joints_on_gravity_is_that_of_least_squares():
    # An offset of the elbow, gravity's parameters, and nuisance terms of every joint.
    old = build_motion(one_way(0, duration=20.0, rate=20.0), model())
    rate = np.array([400.0, 100.0, 900.0])
    context = DesignContext(old, model(), rate, np.full(len(rate), 20.0), 0.05, 20.0)
    offset = Hypothesis(all_effects()['torque_offset'], 1, {})
    problem = DesignProblem(offset, (), np.ones(1), (1,), False)
    information = context.information(problem, old, 0.05)
    k, gravity = context.n_gravity, CHAIN.jacobian(old.samples.q)[2:]
    own = context.nuisance_columns(old)
    per_joint = own.shape[2]
    normal = np.zeros((k + 3 * per_joint,) * 2)
    for n in range(3):
        rows = np.zeros((len(old.samples.q), len(normal)))
        rows[:, :k] = gravity[:, n].T
        rows[:, k + n * per_joint:k + (n + 1) * per_joint] = own[:, n]
        normal += 0.05 * rate[n] * rows.T @ rows
    # The offset of the elbow is the target; nuisance terms of the others are projected out.
    others = np.r_[k:k + per_joint, k + 2 * per_joint:len(normal)]
    kept = np.setdiff1d(np.arange(len(normal)), others)
    marginal = normal[np.ix_(kept, kept)] - normal[np.ix_(kept, others)] @ np.linalg.pinv(
        normal[np.ix_(others, others)], rcond=1e-12) @ normal[np.ix_(others, kept)]
    np.testing.assert_allclose(information[:k, :k], marginal[:k, :k],
                               atol=1e-5 * np.abs(marginal).max())


def test_a_target_remains_ambiguous_while_its_alternative_is_untestable():
    old, known = one_way(0), all_effects()
    still = replace(old, q=old.q * [0.0, 1.0, 0.0], qd=old.qd * [0.0, 1.0, 0.0])
    spring = Hypothesis(known['joint_spring'], 1, {'centre': 0.0, 'overtones': 1.0})
    offset = Hypothesis(known['torque_offset'], 1, {})
    problem = DesignProblem(offset, (spring,), np.ones(1), (1,), False)
    alone = build_motion(still, model())
    reason = known['joint_spring'].untestable(alone, 1)
    assert reason and problem.remaining_ambiguity(alone, ('joint_spring',)) == (
        f'its alternative joint_spring remains untestable: {reason}')
    # It is not ambiguous if the diagnosis does not name the spring, nor if the spring is excited.
    assert not problem.remaining_ambiguity(alone, ())
    assert not problem.remaining_ambiguity(build_motion(old, model()), ('joint_spring',))


def finding(effect, joint, verdict, before=0.1, after=0.05, alternatives=()):
    return Finding(joint, effect, verdict, alternatives, {}, before, after, 0.0, 1.0, '', '')


def test_open_targets_of_a_diagnosis():
    motion = build_motion(one_way(0), model())
    report = JointReport('', 0.05, 100.0, 0.1, 0.1, {'viscous_friction': 'one speed',
                                                     'end_stop': 'not reached'})
    quiet = JointReport('', 0.05, 100.0, 0.1, 0.1, {})
    diagnosis = Diagnosis((
        finding('joint_spring', 'wrist', 'weak', 0.02, 0.019),
        finding('torque_offset', 'elbow', 'established'),
        finding('coulomb_friction', 'elbow', 'ambiguous', alternatives=('torque_offset',)),
        finding('inertia', 'elbow', 'weak'), finding(None, 'elbow', 'unexplained')),
        {NAMES[0]: quiet, NAMES[1]: report, NAMES[2]: quiet})
    targets = open_targets(diagnosis, motion)
    assert [target.name for target in targets] == [
        'coulomb_friction:elbow', 'joint_spring:wrist', 'viscous_friction:elbow']
    assert targets[0].alternatives == ('torque_offset',)
    nothing = Diagnosis((), dict.fromkeys(NAMES, quiet))
    with pytest.raises(OptionError, match='no target is open'):
        plan(one_way(0), model(), None, PlanOptions(), nothing)


@pytest.mark.parametrize('first, is_known', [(0, True), (1, False), (4, False)])
def test_a_payload_size_is_known_if_the_diagnosis_has_the_same_coefficients(first, is_known):
    # The gravity models of diagnosis and plan may contain features of different joints.
    motion, probe = (build_motion(one_way(seed), model()) for seed in (0, 1))
    setting = {'run': 0.0, 'time': 30.0, 'clock': 0.0}
    parts = all_effects()['payload_change'].coefficients_of(motion, 0, setting)
    values = {part.symbol: Estimate(0.1, '1', (0.0, 0.2)) for part in parts[first:]}
    payload = replace(finding('payload_change', None, 'weak'), setting=setting,
                      coefficients=values)
    problem = design_problem(Target('payload_change', None), motion, probe, NOISE,
                             Diagnosis((payload,), {}))
    assert problem.known_size == is_known and len(problem.size) == len(parts) == 4


@pytest.mark.parametrize('target, message', [
    (Target('coulomb_friction', None), 'name it'), (Target('no_such', 'elbow'), 'no effect'),
    (Target('coulomb_friction', 'hip'), 'no joint hip')])
def test_invalid_targets(target, message):
    with pytest.raises(OptionError, match=message):
        plan(one_way(0), model(), [target], PlanOptions(15.0))


def test_a_joint_that_cannot_move():
    still = one_way(0, span=1e-4)
    with pytest.raises(OptionError, match='no joint of the targets can move'):
        plan(still, model(), [Target('coulomb_friction', 'elbow')], PlanOptions(15.0))


@pytest.mark.parametrize('verdict, p, low, high', [
    ('ambiguous', 1e-9, 1.0, 1.0), ('untestable', 1e-9, 1.0, 1.0), ('weak', 0.02, 2.0, 2.1),
    ('weak', 1.0, 0.0, 0.0), ('weak', 1e-12, 3.0, 3.0), ('established', 1e-9, np.inf, np.inf)])
def test_observed_separation_of_open_and_resolved_targets(verdict, p, low, high):
    finding = Finding('a', 'coulomb_friction', verdict, (), {}, 0.1, 0.05, 0.0, 1.0, '', '', p)
    report = JointReport('', 0.1, 50.0, 1.0, 0.5, {'viscous_friction': 'one speed'})
    diagnosis = Diagnosis((finding,), {'a': report})
    seen = observed_separation(Target('coulomb_friction', 'a'), diagnosis)
    assert low <= seen <= high
    assert observed_separation(Target('viscous_friction', 'a'), diagnosis) == 0.0
    assert observed_separation(Target('joint_spring', 'a'), diagnosis) == np.inf


def test_a_rare_effect_needs_a_share_of_the_error():
    # 20 s recorded and 30 s planned at 20 independent samples per second: n = 1000. The share
    # lambda / (lambda + n) is 0.1 at a separation of sqrt(1000 / 9).
    context = DesignContext(build_motion(one_way(0, duration=20.0, rate=20.0), model()), model(),
                            np.full(3, 400.0), np.full(3, 20.0), 0.05, 20.0)

    def required(name, seconds):
        hypothesis = Hypothesis(all_effects()[name], 1, {})
        return context.required_separation(
            DesignProblem(hypothesis, (), np.ones(1), (1,), False), seconds)

    assert required('joint_flexibility', 30.0) == pytest.approx(10.54, rel=1e-2)
    assert required('joint_flexibility', 0.0) < required('joint_flexibility', 30.0)
    assert required('torque_offset', 30.0) == 0.0
    assert power(30.0, 30.0) == pytest.approx(0.5) and power(30.0) > 0.95
    # A required separation below that of half the power has no influence.
    assert power(10.0, 5.0) == power(10.0)


def test_an_effect_that_gravity_absorbs_has_less_chance_and_utility():
    scores = [EffectScore((50.0,), np.ones(1), unabsorbed) for unabsorbed in
              (0.2 * MIN_UNABSORBED, MIN_UNABSORBED, 3.0 * MIN_UNABSORBED)]
    chances = [score.chance_of_certain_size for score in scores]
    assert chances[0] < 1e-3 and chances[1] == pytest.approx(0.5) and chances[2] > 0.999
    assert scores[0].utility < 0.1 and scores[1].utility < scores[2].utility


def test_a_motion_leaves_enough_of_an_offset_unabsorbed():
    # Viscous friction of all joints is resolved sooner, and its motion is narrow.
    targets = [*(Target('viscous_friction', joint) for joint in NAMES),
               Target('torque_offset', 'shoulder')]
    wide = PlanOptions(20.0, low=np.full(3, -1.2), high=np.full(3, 1.2), reach=np.inf)
    *_, offset = plan(one_way(0), model(), targets, wide).expectations
    assert offset.target.effect == 'torque_offset' and offset.unabsorbed > 1.4 * MIN_UNABSORBED
    assert offset.chance > 2.0 * offset.chance_before
