"""Targets of a plan from the findings of a diagnosis."""

from bench.shared.planning_arm import model, one_way
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.planning.questions import open_targets


def finding(effect, joint, verdict, alternatives=()):
    return Finding(joint, effect, verdict, alternatives, {}, 0.1, 0.05, 0.0, 1.0, '', '')


def test_open_findings_come_first():
    regression = estimate(one_way(0), FitOptions('chain'), old=model()).regression
    targets = open_targets(regression, Diagnosis((
        finding('joint_spring', 'wrist', 'weak'), finding('torque_offset', 'elbow', 'established'),
        finding('coulomb_friction', 'elbow', 'ambiguous', ('torque_offset',)),
        finding('rigid_body_dynamics', None, 'weak'), finding(None, 'elbow', 'unexplained')), {}))
    names = [target.name for target in targets]
    assert names[:2] == ['joint_spring:wrist', 'coulomb_friction:elbow']
    assert targets[1].alternatives == ('torque_offset',)
    # Friction that the one-way recording does not excite follows, each once.
    assert {'coulomb_friction:shoulder', 'viscous_friction:elbow'} < set(names[2:])
    assert len(set(names)) == len(names) and 'torque_offset:elbow' not in names
