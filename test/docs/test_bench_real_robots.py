"""Cases on descriptions of real robots: arms, hidden laws, score and table of the bench."""

from dataclasses import replace

from bench.real_robots import arms
from bench.real_robots.cases import case, Case, regressor
from bench.real_robots.laws import Hidden
from bench.real_robots.score import error_ratios, score, table
from bench.shared.campaign import campaign
from bench.shared.findings import Known
from gravity_comp_ros.simulation.arms import gravity_torque
from gravity_comp_ros.simulation.disturbances.friction import Friction, LuGre
from gravity_comp_ros.simulation.disturbances.signals import gauge_offset
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np
import pinocchio as pin
import pytest

pytestmark = pytest.mark.skipif(arms.descriptions() is None,
                                reason='example-robot-data is not installed')
OFFSET = Hidden('torque_offset', 1, gauge_offset(1, 0.5), (('torque_offset', 1),),
                known=Known('torque_offset', 1, 'N·m', 0.5, 0.5), static=True)


@pytest.fixture(scope='module')
def drawn() -> Case:
    return case('so101', 7)


def finding(effect, joint, verdict='established', alternatives=(), ci95=(0.4, 0.6)):
    return {'effect': effect, 'joint': joint, 'verdict': verdict, 'rivals': list(alternatives),
            'coefficients': {'b': {'value': 0.5, 'unit': 'N·m', 'ci95': list(ci95)}}}


def with_offset(drawn: Case) -> Case:
    return replace(drawn, hidden=(OFFSET,), friction=())


@pytest.mark.parametrize('name', list(arms.SOURCES)[::4])
def test_the_chain_has_the_gravity_of_the_whole_robot(name):
    source, arm = arms.SOURCES[name], arms.arm_of(arms.urdf(name))
    assert arm.joints == source.joints
    robot = pin.buildModelFromUrdf(str(arms.descriptions() / source.file))
    robot.gravity.linear = arm.model.gravity.linear
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = rng.uniform(arm.lower, arm.upper)
        pose = pin.neutral(robot)
        middle = (pose < robot.lowerPositionLimit) | (pose > robot.upperPositionLimit)
        pose[middle] = 0.5 * (robot.lowerPositionLimit + robot.upperPositionLimit)[middle]
        joints = [robot.joints[robot.getJointId(joint)] for joint in arm.joints]
        for joint, angle in zip(joints, q):
            pose[joint.idx_q:joint.idx_q + joint.nq] = (
                [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)])
        expected = pin.computeGeneralizedGravity(robot, robot.createData(), pose)
        np.testing.assert_allclose(gravity_torque(arm, [q])[0],
                                   expected[[joint.idx_v for joint in joints]], atol=1e-9)


@pytest.mark.parametrize('name', ['so101', *campaign('kinova')])
def test_least_squares_with_the_exact_laws_leaves_the_noise(name):
    one = case(name, 400)
    motions = one.motions
    arm = arms.arm_of(one.urdf)
    laws = [*one.friction, *(hidden.law for hidden in one.hidden)]

    def columns(motion):
        rigid = synthesise(arm, motion).tau
        acting = [synthesise(arm, motion, SynthesisOptions(disturbances=[law])).tau - rigid
                  for law in laws]
        return np.concatenate([regressor(arm, motion), np.stack(acting, axis=2)], axis=2)

    a = np.concatenate([columns(motion) for motion in motions[:2]]) / one.noise[:, None]
    b = np.concatenate([run.tau for run in one.train]) / one.noise
    x = np.linalg.lstsq(a.reshape(-1, a.shape[2]), b.ravel(), rcond=1e-9)[0]
    np.testing.assert_allclose(error_ratios(one, columns(motions[2]) @ x), 1.0, atol=0.05)


def test_a_perfect_answer_is_right(drawn):
    one = with_offset(drawn)
    torque = one.unseen.tau + one.noise * np.where(np.arange(4500) % 2, 1.0, -1.0)[:, None]
    result = score(one, [finding('torque_offset', one.joints[1])], torque,
                   one.static(one.poses)[0])
    assert result.why == () and result.tied == ()
    assert result.error == pytest.approx(1.0) and result.static == 0.0
    (interval,) = result.intervals
    assert interval.covers and interval.true == (0.5, 0.5)
    text = table([{'case': 'one', 'hidden': ['torque_offset:2'], 'lugre': False, 'before': 9.0,
                   'refused': '', 'seconds': {'fit': 1.0}, **result.to_json()}])
    assert '1 of 1 right;' in text and '1 of 1 published 95 % intervals cover' in text


def test_each_fault_of_an_answer_is_named(drawn):
    one = with_offset(drawn)
    torque = one.unseen.tau.copy()
    torque[:, 3] += 2.0 * one.noise[3]
    static = one.static(one.poses)[0]
    static[:, 2] += 0.01 * one.largest
    result = score(one, [finding('joint_spring', one.joints[0], 'likely')], torque, static)
    assert result.why == ('missed torque_offset:2', 'false joint_spring:1 (likely)',
                          'error 2.00 x noise', 'static 1.00 %')


def test_with_lugre_friction_the_bound_follows_the_oracle(drawn):
    one = with_offset(drawn)
    gears = tuple(Friction(joint, LuGre(0.1)) for joint in range(len(one.joints)))
    one = replace(one, friction=gears)
    answers, static = [finding('torque_offset', one.joints[1])], one.static(one.poses)[0]
    torque, oracle = one.unseen.tau + 2.4 * one.noise, one.unseen.tau + 2.0 * one.noise
    assert score(one, answers, torque, static).why == ('error 2.40 x noise',)
    judged = score(one, answers, torque, static, oracle)
    assert judged.why and judged.why_oracle == ()
    assert score(replace(one, friction=()), answers, torque, static, oracle).why_oracle
    # A hidden friction counts on its joint.
    hidden = replace(one, friction=(), hidden=(*one.hidden, replace(
        OFFSET, law=gears[2], static=False)))
    off = one.unseen.tau + 2.4 * one.noise * (np.arange(len(gears)) == 2)
    assert score(hidden, answers, off, static, oracle).why_oracle == ()
    # Each joint has its own oracle.
    oracle[:, 3] = one.unseen.tau[:, 3]
    assert score(one, answers, torque, static, oracle).why_oracle == ('error 2.40 x noise',)
