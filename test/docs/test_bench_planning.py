"""Benchmark of planned motion: poor recordings, verdicts and tables."""

from bench.cases.six_axis import six_axis
from bench.planning.baselines import random_near, random_slow
from bench.planning.poor import KINDS as POOR_KINDS, RATE
from bench.planning.run import judged
from bench.planning.scenes import Scene
from bench.planning.table import calibration, resolved
from gravity_comp_ros.data.runs import session_time
from gravity_comp_ros.data.samples import concatenate
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


@pytest.mark.parametrize('poor', POOR_KINDS)
@pytest.mark.parametrize('arm', ['iiwa7', 'drawn0'])
def test_poor_recordings(arm, poor):
    scene = Scene(arm, 'coulomb_friction', JOINT, poor, 0)
    motion = scene.poor_motion()
    slope, bend = (np.gradient(x, 1 / RATE, axis=0) for x in (motion.q, motion.qd))
    assert np.abs(slope - motion.qd)[2:-2].max() < 2e-3
    assert np.abs(bend - motion.qdd)[2:-2].max() < 0.1
    own, others = motion.qd[:, JOINT], np.delete(motion.q, JOINT, axis=1)
    if poor == 'one_way':
        assert own.min() > 0.0
    if poor == 'narrow':
        assert np.ptp(motion.q, axis=0).max() <= 0.3
    if poor == 'one_speed':
        assert np.mean(np.abs(np.abs(own) - 0.1) < 1e-9) > 0.85 and own.min() < 0.0
    if poor == 'one_posture':
        assert not np.ptp(others, axis=0).any() and np.ptp(motion.q[:, JOINT]) > 0.3
    if poor == 'few_reversals':
        assert np.count_nonzero(np.diff(np.sign(own[np.abs(own) > 1e-3]))) == 3
    if poor == 'joint_narrow':
        assert np.ptp(motion.q[:, JOINT]) < 0.31 < np.ptp(others, axis=0).min()
    if poor.startswith('settled'):
        moving, rest = np.abs(own) > 1e-6, np.abs(np.delete(motion.qd, JOINT, 1)).max(1) > 1e-6
        assert moving.any() and rest.any() and not (moving & rest).any()


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


def test_a_later_recording_continues_the_session():
    scene = Scene('six_axis', 'friction_drift', JOINT, 'few_reversals', 0)
    old, motion = scene.recorded(), random_slow(scene.recorded(), PlanOptions(20.0), 0)
    new = scene.later(motion)
    np.testing.assert_allclose(new.q, motion.q, atol=1e-9)
    assert session_time(concatenate([old, new]))[-1] == pytest.approx(90.0 + new.t[-1])
    # A warm gear has less friction than a cold one on the same motion.
    cold = synthesise(six_axis(), motion).tau[:, JOINT]
    fresh = scene._samples(motion, 1).tau[:, JOINT]
    warm = new.tau[:, JOINT]
    assert np.abs(warm - cold).mean() < 0.9 * np.abs(fresh - cold).mean()


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
