"""Scores of the campaign for given findings, and its files."""

from importlib import import_module

from bench.cases.case_list import case
from bench.cases.cases import ARMS
from gravity_comp_ros.effects.rigid_body import DYNAMICS
import pytest

# The campaign is not part of the installed package.
run, table, score = (import_module(f'bench.campaign.{name}') for name in ('run', 'table', 'score'))

JOINTS = ARMS['iiwa7']().joints
SHOULDER, ELBOW = JOINTS[1], JOINTS[3]


def finding(effect, joint=SHOULDER, verdict='established', alternatives=(), **coefficients):
    return {'effect': effect, 'joint': joint, 'verdict': verdict, 'rivals': list(alternatives),
            'coefficients': {name: {'value': v, 'unit': unit, 'ci95': [low, high]}
                             for name, (v, unit, low, high) in coefficients.items()}}


def judge(name, *findings, untestable=None):
    joints = {joint: {'untestable': {}, 'rmse_after': 0.1} for joint in JOINTS}
    if untestable:
        joints[SHOULDER]['untestable'] = untestable
    return score.score(case('iiwa7', name), {'findings': list(findings), 'joints': joints}, JOINTS)


COULOMB = finding('coulomb_friction', F_c=(2.01, 'N·m', 1.97, 2.05))


def test_the_true_effect_on_its_joint_is_right():
    judged = judge('coulomb_large', COULOMB)
    assert judged.right and judged.named == (True,) and judged.false == ()
    assert [(i.truth, i.covers) for i in judged.intervals] == [(2.0, True)]


def test_another_joint_or_effect_is_a_false_alarm_and_a_miss():
    for wrong in (finding('coulomb_friction', ELBOW), finding('torque_offset')):
        judged = judge('coulomb_large', wrong)
        assert judged.named == (False,) and len(judged.false) == 1 and not judged.right
    assert judge('coulomb_large', finding('coulomb_friction', ELBOW)).false == (
        'coulomb_friction:4 (established)',)
    both = judge('coulomb_large', COULOMB, finding('stribeck_friction', verdict='likely'))
    assert both.named == (True,) and not both.right and len(both.false) == 1


def tied(*alternatives, verdict='ambiguous'):
    return finding('stribeck_friction', verdict=verdict, alternatives=alternatives)


WEAK = finding('coulomb_friction', verdict='weak')
OFFSET = finding('torque_offset', verdict='untestable')


@pytest.mark.parametrize('name, findings, right', [
    # Effects that a case allows are no false alarms.
    ('coulomb_large', [COULOMB, finding('presliding_hysteresis'), finding(DYNAMICS, None)],
     True),
    ('nothing_white', [finding(DYNAMICS, None)], True),
    ('nothing_white', [finding('viscous_friction', verdict='likely')], False),
    # An ambiguous finding counts if the truth is among its alternatives.
    ('coulomb_large', [tied('coulomb_friction')], True),
    ('coulomb_large', [tied(f'coulomb_friction:{SHOULDER}')], True),
    ('coulomb_large', [tied(f'coulomb_friction:{ELBOW}')], False),
    ('coulomb_large', [tied('viscous_friction')], False),
    ('coulomb_large', [tied('coulomb_friction', verdict='weak')], False),
    # A weak finding is neither found nor false.
    ('coulomb_large', [WEAK], False), ('nothing_white', [WEAK], True), ('too_weak', [WEAK], True),
    ('too_weak', [], True), ('too_weak', [finding('torque_offset')], False),
    # Alternatives of a truth, and effects of the whole arm.
    ('cable', [finding('joint_spring', ELBOW)], True),
    ('cable', [finding('cable_stiffness', None)], False),
    ('tilted_base', [finding('base_tilt', None)], True),
    ('tilted_base', [finding('base_tilt', JOINTS[0])], True),
    # Every truth has to be named.
    ('coulomb_and_viscous', [finding('coulomb_friction', ELBOW)], False),
    ('coulomb_and_viscous', [finding('coulomb_friction', ELBOW),
                             finding('viscous_friction', ELBOW)], True),
    # `unexplained` has to name the joint.
    ('detent', [finding(None, ELBOW, 'unexplained')], True),
    ('detent', [finding(None, SHOULDER, 'unexplained')], False), ('detent', [], False),
    ('detent', [finding(None, ELBOW, 'unexplained'), finding('torque_ripple', ELBOW)], False),
    # `untestable` has to name both.
    ('one_way', [{**OFFSET, 'rivals': ['coulomb_friction']}], True),
    ('one_way', [finding('coulomb_friction', verdict='ambiguous',
                         alternatives=['torque_offset'])], True),
    ('one_way', [OFFSET], False), ('one_way', [finding('torque_offset')], False),
    ('one_way', [], False)])
def test_an_answer_is_right_or_wrong(name, findings, right):
    assert judge(name, *findings).right == right


def done(name, seed, *findings, floor=0.1):
    entry = case('iiwa7', name)
    joints = {joint: {'untestable': {}, 'rmse_after': 0.11} for joint in JOINTS}
    result = {'diagnosis': {'findings': list(findings), 'joints': joints}, 'seconds': 2.0,
              'joints': list(JOINTS), 'peak_mb': 100.0, 'code': 'x', 'rate': 50.0}
    if entry.verdict == 'found':
        result['floor'] = dict.fromkeys(JOINTS, floor)
    return table.Task(entry, seed, 50.0), result


def test_totals_by_hand():
    rows = [done('coulomb_large', 0, COULOMB), done('coulomb_large', 1),
            done('coulomb_large', 2, COULOMB, floor=0.05),
            done('nothing_white', 0), done('nothing_white', 1, finding('joint_spring')),
            done('detent', 0, finding(None, ELBOW, 'unexplained'))]
    every = table.summary(rows)['all']
    assert (every['recordings'], every['solvable'], every['nothing_missing']) == (6, 3, 2)
    assert every['named'] == pytest.approx(2 / 3) and every['false_alarms'] == 0.5
    assert every['covered'] == 1.0 and every['intervals'] == 2 and every['open_said'] == 1.0
    # Errors are 0.11 N·m relative to floors of 0.1, 0.1 and 0.05 N·m.
    assert every['error_within'] == pytest.approx(2 / 3) and every['with_error'] == 3
    assert every['error_ratio_max'] == pytest.approx(2.2)
    assert every['missed'] == ['seed 1: coulomb_friction:2']
    assert every['false'] == ['seed 1: joint_spring:2 (established)']
    text = table.markdown(rows)
    assert '| iiwa7 coulomb_large | 67 % | 67 % | 0 % | 100 % | 1.1, at most 2.2 |' in text
