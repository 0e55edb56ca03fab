"""Planned motion and its expected results on an arm of known gravity."""

from dataclasses import replace
from functools import cache

from bench.shared.planning_arm import model, NAMES, one_way, played
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.diagnosis.diagnose import conclude
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import model_of
from gravity_comp_ros.planning.criterion import _evidence, uncertain_joints
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.planning.questions import named_targets, open_targets, questions_of
from gravity_comp_ros.planning.sums import Sums
from gravity_comp_ros.planning.workspace import Line, PlanOptions, sampled
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.design import Design
from gravity_comp_ros.regression.gains import gain, score_of
from gravity_comp_ros.regression.posterior import solve
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.shared import State
import numpy as np
import pytest

ELBOW = 1


@cache
def estimated(offset=0.0):
    """Return the estimate of a one-way recording, with an offset of the elbow in N·m."""
    return estimate(with_offset(one_way(0), offset), FitOptions('chain'), old=model())


def with_offset(samples, offset):
    return replace(samples, tau=samples.tau + offset * np.eye(3)[ELBOW])


def back_and_forth(*turns):
    """Return lines of the elbow, back and forth between angles in rad."""
    poses = [np.array([0.1, turn, -0.1]) for turn in turns]
    return [Line(a, b, PlanOptions(max_speed=0.2)) for a, b in zip(poses, poses[1:])]


def asked(target, path):
    """Return sums and question of a target with a path as the probe."""
    keys = named_targets([target], NAMES)
    sums, (question,), _ = questions_of(estimated().regression, keys, path, 15.0)
    return sums, question


def test_friction_of_a_joint_that_moved_in_one_direction():
    planned = plan(one_way(0), model(), ['coulomb_friction:elbow'], PlanOptions(15.0),
                   estimated=estimated())
    (expected,) = planned.expectations
    assert expected.chance_before == 0.0 and expected.chance > 0.9 and expected.is_likely
    assert all('elbow' in part.joints for part in planned.parts)
    q, qd = planned.trajectory.q, planned.trajectory.qd
    assert qd[:, ELBOW].min() < -0.05 and qd[:, ELBOW].max() > 0.05
    assert np.ptp(q[:, ELBOW]) > 0.1
    # The prior of Coulomb friction is a tenth of the torque scale.
    scale = estimated().regression.problem.scale.torque[ELBOW]
    assert expected.assumed['F_c'] == pytest.approx(0.1 * scale) and not expected.size_is_measured


def test_planned_sums_are_those_of_the_recording_of_the_motion():
    path = back_and_forth(0.0, 0.3, -0.3, 0.2)
    sums, _ = asked('coulomb_friction:elbow', path)
    t, (q, qd, qdd) = sampled(path, 100.0)
    old, shared = estimated().regression.problem, estimated().regression.shared
    problem = Problem.of(played(Trajectory(NAMES, t, q, qd, qdd)), None, old.options)
    motion = problem.motion.with_gravity(shared.gravity(q), shared.gradient, shared.chain)
    factory = TermFactory(lambda: motion, problem.rows, old.scale)
    columns = problem.rows.mean(shared.columns(State(q, qd, motion.qdd)))
    design = Design(problem.rows, problem.y, columns @ sums.root, shared.prior(old.scale),
                    np.ones_like(problem.y))
    terms = [factory.term(term.effect, term.joint, term.setting) for term in sums.terms]
    design.add(terms)
    expected = np.zeros_like(sums.recorded)
    for j in range(3):
        here = [k for k, term in enumerate(terms) if j in term.joints(3)]
        places = sums.places([sums.terms[k] for k in here])
        chosen = design.selected(j, [terms[k] for k in here])
        expected[np.ix_(places, places)] += sums.weights[j] * design.gram[j][
            np.ix_(chosen, chosen)]
    # In units of the prior, relative to the largest products of each coefficient.
    size = sums.std * np.sqrt(np.diag(expected))
    size = np.maximum(size, 1e-3 * size.max()) / sums.std
    error = (sums.added([path])[0] - expected) / np.outer(size, size)
    # Accelerations of a recording are smoothed at starts and stops, those of a plan are exact.
    # They change the columns of tilts and lengths, not those of moments.
    gravity = np.r_[6:12, sums.at(sums.terms)]
    assert np.abs(error[np.ix_(gravity, gravity)]).max() < 0.02
    assert np.abs(error).max() < 0.15


@pytest.mark.parametrize('effect', ['torque_offset', 'coulomb_friction', 'joint_spring'])
def test_information_and_evidence_are_those_of_the_engine(effect):
    sums, question = asked(f'{effect}:elbow', back_and_forth(0.0, 0.3, -0.3))
    term, design = question.term, estimated().regression.posterior.design
    without = solve(design, question.base, sums.weights)
    scored = score_of(without, term)
    information = question._information(sums.recorded, (term,))
    size = np.sqrt(np.outer(*2 * [np.diag(scored.own)]))
    assert np.abs(information - scored.information).max() < 1e-6 * size.max()
    assert question.identified(sums.recorded) == pytest.approx(scored.identified.max(), rel=1e-3)
    evidence = _evidence(term, scored.information, scored.score[None])[0]
    assert evidence == pytest.approx(gain(without, scored, 1.0), rel=1e-9)


def test_the_alternative_determines_the_motion():
    # Load friction is distinguished from Coulomb friction by a change of load only.
    target = 'load_dependent_friction:elbow'
    wide = PlanOptions(20.0, low=np.full(3, -0.8), high=np.full(3, 0.8), reach=np.inf)
    planned = plan(one_way(0), model(), [target], wide, estimated=estimated())
    load = np.abs(model().predict(planned.trajectory.q)[:, ELBOW])
    moving = np.abs(planned.trajectory.qd[:, ELBOW]) > 0.02
    assert np.ptp(load[moving]) > 0.3


def test_an_offset_after_one_way_motion_is_separated_from_friction():
    old = with_offset(one_way(0), 1.5)
    first = estimated(1.5)
    targets = open_targets(first.regression, conclude(first, model()))
    assert ('coulomb_friction', ELBOW) in targets
    planned = plan(old, model(), None, PlanOptions(20.0), estimated=first)
    assert any(each.target == 'coulomb_friction:elbow' and each.is_likely
               for each in planned.expectations)
    both = concatenate([old, with_offset(played(planned.trajectory), 1.5)])
    after = estimate(both, FitOptions('chain'), old=model()).regression
    assert ('coulomb_friction', ELBOW) not in after.gains
    assert ('coulomb_friction', ELBOW) not in after.candidates.untestable
    assert not {key for key in after.gains if key[1] != ELBOW}


def test_friction_is_found_after_the_motion_without_an_alternative():
    old = one_way(0, friction=0.4)
    planned = plan(old, model(), ['coulomb_friction:elbow'], PlanOptions(15.0))
    (expected,) = planned.expectations
    both = concatenate([old, played(planned.trajectory, friction=0.4)])
    after = estimate(both, FitOptions('chain'), old=model()).regression
    term = next(term for term in after.terms if term.key == ('coulomb_friction', ELBOW))
    assert not after.alternatives[term.key]
    value = after.posterior.beta[after.posterior.at[term]][0]
    width, unit = expected.half_width['F_c']
    assert unit == 'N·m' and abs(value - 0.4) < 2.0 * width
    # The plan allows for viscous friction, which this joint does not have.
    assert 0.3 * width / 1.96 < after.posterior.std(term)[0] < width / 1.96


def test_the_effect_that_the_recordings_measure_has_its_size():
    old = one_way(0)
    moved = plan(old, model(), ['coulomb_friction:elbow'], PlanOptions(15.0),
                 estimated=estimated()).trajectory
    both = concatenate([one_way(0, friction=0.4), played(moved, friction=0.4)])
    planned = plan(both, model(), ['coulomb_friction:elbow'], PlanOptions(15.0))
    (expected,) = planned.expectations
    assert expected.size_is_measured and expected.assumed['F_c'] == pytest.approx(0.4, abs=0.05)
    assert expected.chance_before > 0.9 and expected.chance > 0.9


def test_nothing_is_open():
    moved = plan(one_way(0), model(), None, PlanOptions(20.0), estimated=estimated()).trajectory
    both = concatenate([one_way(0), played(moved)])
    with pytest.raises(OptionError, match='no finding is open: name targets'):
        plan(both, model(), None, PlanOptions())


@pytest.mark.parametrize('target, message', [
    ('no_such:elbow', 'no effect'), ('rigid_body_dynamics', 'every fit estimates'),
    ('coulomb_friction:hip', "no joint 'hip'")])
def test_invalid_targets(target, message):
    with pytest.raises(OptionError, match=message):
        plan(one_way(0), model(), [target], PlanOptions(15.0), estimated=estimated())


def test_a_joint_that_cannot_move():
    still = one_way(0, span=1e-4)
    options = PlanOptions(15.0)
    with pytest.raises(OptionError, match='no joint of the targets can move'):
        plan(still, model(), ['coulomb_friction:elbow'], options,
             estimated=estimated())


def finding(effect, joint, verdict, alternatives=()):
    return Finding(joint, effect, verdict, alternatives, {}, 0.1, 0.05, 0.0, 1.0, '', '')


def test_open_findings_come_first():
    regression = estimate(one_way(0), FitOptions('chain'), old=model()).regression
    targets = open_targets(regression, Diagnosis((
        finding('joint_spring', 'wrist', 'weak'), finding('torque_offset', 'elbow', 'established'),
        finding('coulomb_friction', 'elbow', 'ambiguous', ('torque_offset',)),
        finding('rigid_body_dynamics', None, 'weak'), finding(None, 'elbow', 'unexplained')), {}))
    assert targets[:2] == [('joint_spring', 2), ('coulomb_friction', ELBOW)]
    # Friction that the one-way recording does not excite follows, each once.
    assert {('coulomb_friction', 0), ('viscous_friction', ELBOW)} < set(targets[2:])
    assert len(set(targets)) == len(targets) and ('torque_offset', ELBOW) not in targets


WIDE = PlanOptions(20.0, low=np.full(3, -1.2), high=np.full(3, 1.2), reach=np.inf)


@pytest.fixture(scope='module')
def estimated_gravity():
    return estimate(one_way(0, span=0.3), FitOptions('chain'), old=model())


def test_the_uncertainty_is_that_of_the_model(estimated_gravity):
    old = one_way(0, span=0.3)
    # Without a motion it is the published posterior.
    sums = Sums(estimated_gravity.regression, estimated_gravity.regression.terms, 0.0)
    std = model_of(estimated_gravity).predict_std(old.q)
    now, after = sums.gravity_std(sums.recorded * np.array([1.0, 4.0])[:, None, None])
    np.testing.assert_allclose(now, np.sqrt((std ** 2).mean(axis=0)), rtol=0.05)
    assert uncertain_joints(sums, True) == tuple(np.argsort(-now))
    assert (after < 0.75 * now).all()


def test_a_plan_reduces_the_uncertainty(estimated_gravity):
    planned = plan(one_way(0, span=0.3), model(), ['gravity'], WIDE,
                   estimated=estimated_gravity)
    assert {each.joint for each in planned.gravity} == set(NAMES) and not planned.expectations
    assert all(each.after < each.before for each in planned.gravity)
    assert 'uncertain by' in planned.gravity[0].sentence and planned.to_json()['gravity']
