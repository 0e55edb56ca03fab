"""Benchmark of planned motion: poor recordings, verdicts and tables."""

from bench.cases.six_axis import six_axis
from bench.planning.baselines import random_near, random_slow
from bench.planning.run import judged
from bench.planning.scenes import Scene
from bench.planning.table import calibration, resolved
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.planning import PlanOptions
from gravity_comp_ros.planning.workspace import workspace
from gravity_comp_ros.simulation.synthesise import synthesise
import numpy as np
import pytest

JOINT = 1


def finding(joint, effect, verdict):
    return Finding(joint, effect, verdict, (), {}, 0.1, 0.05, 0.0, 1.0, '', '')


@pytest.mark.parametrize('effect', ['coulomb_friction', 'viscous_friction', 'torque_offset'])
def test_recordings_and_verdicts(effect):
    scene = Scene('six_axis', effect, JOINT, 'narrow', 0)
    motion = scene.poor_motion()
    samples = scene.recorded()
    name = samples.names[JOINT]
    added = np.sqrt(((samples.tau - synthesise(six_axis(), motion).tau) ** 2).mean(axis=0))
    # The hidden effect is on this joint only; the others have noise of 0.1 N·m.
    assert added[JOINT] > 0.11 and np.delete(added, JOINT) == pytest.approx(0.1, rel=0.1)
    for findings, verdict in (
            ((finding(name, effect, 'likely'), finding(None, DYNAMICS, 'established')), 'right'),
            ((finding(name, effect, 'ambiguous'),), 'open'), ((), 'open'),
            ((finding(name, effect, 'likely'), finding(name, 'joint_spring', 'likely')),
             'wrong: joint_spring'),
            ((finding(samples.names[0], effect, 'likely'),), 'open')):
        assert judged(Diagnosis(findings, {}), scene) == verdict
    options = PlanOptions(20.0)
    other = random_slow(samples, options, 0)
    assert np.abs(other.qd).max() <= 0.3 and (other.q <= samples.q.max(axis=0) + 2e-3).all()
    near = random_near(samples, options, JOINT, 0)
    assert workspace(samples, options).admits(near.q)
    assert np.flatnonzero(np.ptp(near.q, axis=0) > 1e-9).tolist() == [0, 1, 2]


def test_the_tables_count():
    expected = {'effect': 'coulomb_friction', 'joint': 'a', 'outcome': 'established',
                'share': 1.0, 'chance': 1.0}
    one = {'name': 'a', 'effect': 'coulomb_friction', 'poor': 'narrow', 'tie': False,
           'left': 'absent'}
    results = [{**one, 'before': 'right', 'ways': {}},
               {**one, 'before': 'open', 'left': 'weak', 'ways': {
                   'planned': {'verdict': 'right', 'expected': [expected]},
                   'random': {'verdict': 'open'}, 'fourier': {'verdict': 'right'}}}]
    lines = resolved(results).splitlines()
    assert '| narrow | 2 | 1 | 1 | 1 | 0 | 1 | 1 |' in lines
    assert '| all reported open | 1 | 0 | 1 | 1 | 0 | 1 | 1 |' in lines
    assert '| 90% to 100% | 1 | 100% | 100% |' in calibration(results).splitlines()
