"""The bench of planned motion: its recordings lack what they say, and its judge is right."""

from bench.planning.run import judged, table
from bench.planning.scenes import ARMS, EFFECTS, POOR, random_slow, RATE, Scene
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding
from gravity_comp_ros.planning import PlanOptions
from gravity_comp_ros.simulation.six_axis import six_axis
from gravity_comp_ros.simulation.synthesise import synthesise
import numpy as np
import pytest

JOINT = 1


def found(joint, effect, verdict):
    return Finding(joint, effect, verdict, (), {}, 0.1, 0.05, 0.0, 1.0, '', '')


@pytest.mark.parametrize('poor', POOR)
@pytest.mark.parametrize('arm', ARMS)
def test_poor_recordings_lack_what_they_say(arm, poor):
    scene = Scene(arm, 'coulomb_friction', JOINT, poor, 0)
    motion = scene.poor_motion()
    slope = np.gradient(motion.q, 1 / RATE, axis=0)
    assert np.abs(slope - motion.qd)[2:-2].max() < 2e-3
    mine, others = motion.qd[:, JOINT], np.delete(motion.q, JOINT, axis=1)
    if poor == 'one_way':
        assert mine.min() > 0.0
    if poor == 'narrow':
        assert np.ptp(motion.q, axis=0).max() <= 0.3
    if poor == 'one_speed':
        assert np.mean(np.abs(np.abs(mine) - 0.1) < 1e-9) > 0.85 and mine.min() < 0.0
    if poor == 'one_posture':
        assert not np.ptp(others, axis=0).any() and np.ptp(motion.q[:, JOINT]) > 0.3


@pytest.mark.parametrize('effect', EFFECTS)
def test_recordings_and_judge(effect):
    scene = Scene('six_axis', effect, JOINT, 'narrow', 0)
    motion = scene.poor_motion()
    samples = scene.recorded(motion, 0)
    name = samples.names[JOINT]
    more = np.sqrt(((samples.tau - synthesise(six_axis(), motion).tau) ** 2).mean(axis=0))
    # What is hidden is on this joint alone; the others have noise of 0.1 N·m.
    assert more[JOINT] > 0.11 and np.delete(more, JOINT) == pytest.approx(0.1, rel=0.1)
    for findings, verdict in (
            ((found(name, effect, 'likely'), found(name, 'inertia', 'established')), 'right'),
            ((found(name, effect, 'ambiguous'),), 'open'), ((), 'open'),
            ((found(name, effect, 'likely'), found(name, 'joint_spring', 'likely')),
             'wrong: joint_spring'),
            ((found(samples.names[0], effect, 'likely'),), 'open')):
        assert judged(Diagnosis(findings, {}), scene, samples) == verdict
    other = random_slow(samples, PlanOptions(20.0), 0)
    assert np.abs(other.qd).max() <= 0.3 and (other.q <= samples.q.max(axis=0) + 2e-3).all()


def test_the_table_counts():
    done = {'a-coulomb_friction-2-narrow-0': {'before': 'right'},
            'b-coulomb_friction-2-narrow-0': {'before': 'open', 'planned': 'right',
                                              'random': 'open', 'fourier': 'right'}}
    assert table(done).splitlines()[-1] == '| narrow | 2 | 1 | 1 | 1 | 0 | 1 |'
