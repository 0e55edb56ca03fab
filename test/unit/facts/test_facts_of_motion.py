"""Facts about the motion and the efforts of recordings, checked by hand."""

from dataclasses import replace

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.facts.motion import count_reversals, describe
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = arms.iiwa7()
NOISE = SynthesisOptions(noise=NoiseOptions(absolute=0.1))


def remarks(samples, word, **options):
    return [text for text in describe(samples, **options).remarks if word in text]


@pytest.mark.parametrize(('q', 'count'), [
    ([0, 1, 2, 3], 0), ([0, 1, 0], 1), ([0, 1, 0.5, 2], 2), ([0, -1, 0, -1, 0], 3),
    ([0, 0, 0], 0), ([0, 0.005, 0, 0.005, 0], 0), ([0, 1, 0.995, 1, 2], 0), ([5], 0)])
def test_reversals_by_hand(q, count):
    assert count_reversals(np.array(q, dtype=float)) == count


def test_facts_by_hand():
    t = np.arange(5.0)
    q = np.array([[0, 1.0], [1, 1.0], [2, 1.0], [1, 1.0], [0, 1.0]])
    qd = np.array([[1, 0.0], [1, 0.0], [0, 0.0], [-1, 0.0], [-2, 0.0]])
    tau = np.array([[1, 3.0], [2, 3.0], [3, 3.0], [2, 3.0], [7, 3.0]])
    facts = describe(JointSamples.single_run('ab', t, q, qd, tau), GateOptions(max_speed=1.5))
    a, b = facts.joints['a'], facts.joints['b']
    assert (a.q_min, a.q_max, a.travel, a.max_speed, a.reversals) == (0, 2, 2, 2, 1)
    assert a.rms_speed == pytest.approx(np.sqrt(7 / 5))
    assert (a.tau_min, a.tau_max, a.slow_travel) == (1, 7, 2)
    assert (b.travel, b.reversals, b.tau_std) == (0, 0, 0)
    assert facts.slow_share == pytest.approx(0.8) and facts.kept == 4
    assert any('never moves: b' in text for text in facts.remarks)


def test_poses_at_rest():
    poses = synthesise(ARM, motions.random_poses(ARM.lower, ARM.upper, 300), NOISE)
    facts = describe(poses)
    assert facts.at_rest and facts.slow_share == 1 and facts.kept == 300
    assert all(joint.reversals is None for joint in facts.joints.values())
    assert len(facts.remarks) == 1 and 'poses at rest' in facts.remarks[0]


def test_short_one_way_and_narrow():
    short = synthesise(ARM, motions.eq17(duration=4, start=2.0), NOISE)
    facts = describe(short)
    assert any('keeps 20 of 20 samples' in text for text in facts.remarks)
    one_way = remarks(short, 'one direction only')[0]
    for name, joint in facts.joints.items():
        assert (name in one_way) == (joint.travel >= 0.01 and joint.reversals == 0)
    assert 'iiwa_joint_4' in one_way
    assert 'iiwa_joint_7' in remarks(short, 'moves little')[0]


def test_reversals_between_runs_do_not_count():
    up = synthesise(ARM, motions.eq17(duration=4, start=2.0), NOISE)
    down = replace(up, q=-up.q, qd=-up.qd)
    assert describe(concatenate([up, down])).joints['iiwa_joint_4'].reversals == 0


def test_slow_samples_at_rest_in_a_fast_recording():
    motion = motions.eq15(duration=20, rate=10)
    fast = synthesise(ARM, motion, NOISE)
    waiting = replace(fast, q=np.tile(fast.q[:1], (200, 1)), qd=np.zeros_like(fast.qd))
    whole = JointSamples.single_run(
        fast.names, np.arange(400) / 10, np.concatenate([waiting.q, fast.q]),
        np.concatenate([waiting.qd, fast.qd]), np.concatenate([waiting.tau, fast.tau]))
    (text,) = remarks(whole, 'cover little')
    assert 'iiwa_joint_1' in text and ' rad' in text
