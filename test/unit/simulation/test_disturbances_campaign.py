"""Scores of the campaign for given findings, and its totals."""

from bench.campaign.judging import coulomb, offset
from bench.campaign.score import score, table
from bench.cases.cases import ARMS, Case, Truth
from gravity_comp_ros.effects.rigid_body import DYNAMICS
import pytest

JOINTS = ARMS['iiwa7']().joints
SHOULDER, ELBOW = JOINTS[1], JOINTS[3]
CASES = {
    'coulomb': Case('coulomb', 'iiwa7', truths=(coulomb(1, 2.0),),
                    allowed=frozenset({('presliding_hysteresis', 1)})),
    'cable': Case('cable', 'iiwa7', truths=(
        Truth('cable_stiffness', 3, (('joint_spring', 3),)),)),
    'tilt': Case('tilt', 'iiwa7', truths=(Truth('base_tilt', None),)),
    'both': Case('both', 'iiwa7', truths=(coulomb(3), Truth('viscous_friction', 3))),
    'one_way': Case('one_way', 'iiwa7', True, truths=(coulomb(1, 1.0), offset(1)))}


def finding(effect, joint=SHOULDER, verdict='established', alternatives=(), **coefficients):
    return {'effect': effect, 'joint': joint, 'verdict': verdict, 'rivals': list(alternatives),
            'coefficients': {name: {'value': v, 'unit': unit, 'ci95': [low, high]}
                             for name, (v, unit, low, high) in coefficients.items()}}


def diagnosis(*findings):
    return {'findings': list(findings),
            'joints': {joint: {'untestable': {}, 'rmse_after': 0.11} for joint in JOINTS}}


def judge(name, *findings):
    return score(CASES[name], diagnosis(*findings), JOINTS)


COULOMB = finding('coulomb_friction', F_c=(2.01, 'N·m', 1.97, 2.05))


def test_the_true_effect_on_its_joint_is_right():
    judged = judge('coulomb', COULOMB)
    assert judged['right'] and judged['named'] == [True] and judged['wrong'] == []
    assert judged['covers'] == [True]
    off = finding('coulomb_friction', F_c=(2.05, 'N·m', 2.01, 2.09))
    assert judge('coulomb', off)['covers'] == [False]


def tied(*alternatives, verdict='ambiguous'):
    return finding('stribeck_friction', verdict=verdict, alternatives=alternatives)


OFFSET = finding('torque_offset', verdict='untestable')


@pytest.mark.parametrize('name, findings, right', [
    # Effects that a case allows are no false alarms.
    ('coulomb', [COULOMB, finding('presliding_hysteresis'), finding(DYNAMICS, None)], True),
    # An ambiguous finding counts if the truth is among its alternatives.
    ('coulomb', [tied('coulomb_friction')], True),
    ('coulomb', [tied(f'coulomb_friction:{ELBOW}')], False),
    ('coulomb', [tied('coulomb_friction', verdict='weak')], False),
    # A weak finding is neither found nor false.
    ('coulomb', [finding('coulomb_friction', verdict='weak')], False),
    ('coulomb', [COULOMB, finding('torque_offset', verdict='weak')], True),
    ('coulomb', [COULOMB, finding('stribeck_friction', verdict='likely')], False),
    # Alternatives of a truth, and effects of the whole arm.
    ('cable', [finding('joint_spring', ELBOW)], True),
    ('tilt', [finding('base_tilt', None)], True),
    # Every truth has to be named.
    ('both', [finding('coulomb_friction', ELBOW)], False),
    ('both', [finding('coulomb_friction', ELBOW), finding('viscous_friction', ELBOW)], True),
    # `untestable` has to name both, and nothing else.
    ('one_way', [{**OFFSET, 'rivals': ['coulomb_friction']}], True),
    ('one_way', [finding('coulomb_friction', verdict='ambiguous',
                         alternatives=['torque_offset'])], True),
    ('one_way', [{**OFFSET, 'rivals': ['coulomb_friction']}, finding('joint_spring')], False),
    ('one_way', [finding('torque_offset')], False)])
def test_an_answer_is_right_or_wrong(name, findings, right):
    assert judge(name, *findings)['right'] == right


def done(name, seed, *findings, floor=0.1):
    result = {'arm': 'iiwa7', 'kind': name, 'seed': seed, 'seconds': 2.0,
              'diagnosis': diagnosis(*findings), **judge(name, *findings)}
    return result if CASES[name].untestable else {
        **result, 'floor': dict.fromkeys(JOINTS, floor)}


def test_totals_by_hand():
    rows = [done('coulomb', 0, COULOMB), done('coulomb', 1, finding('joint_spring')),
            done('coulomb', 2, COULOMB, floor=0.05),
            done('one_way', 0, {**OFFSET, 'rivals': ['coulomb_friction']})]
    # Errors are 0.11 N·m relative to floors of 0.1, 0.1 and 0.05 N·m.
    assert ('| all | 2 of 3 | 1 of 1 | 1 of 4 | 2 of 2 | 2 of 3, 2.20 | 2, 2 | '
            'seed 1: missed coulomb_friction; seed 1: joint_spring:2 (established) |') in (
        table(rows))
