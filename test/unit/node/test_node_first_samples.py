"""Facts about the samples of a first model."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.node import checks, first_samples
from gravity_comp_ros.node.epoch import Rows
from gravity_comp_ros.node.job_messages import FAULTS, FitJob
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.motions import multisine
import numpy as np


def job():
    """Return a minute of slow motion of an iiwa."""
    arm = iiwa7()
    motion = multisine(arm.lower, arm.upper, np.full(7, 0.4), 3, duration=60.0, rate=5.0)
    tau = gravity_torque(arm, motion.q) + 0.05 * np.random.default_rng(0).standard_normal(
        motion.q.shape)
    samples = JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)
    return FitJob(Rows(samples, np.arange(len(samples)) // 5 % 4 == 3), None, None)


def test_a_gain_that_the_last_samples_do_not_show_is_no_fault_of_the_effort(monkeypatch):
    """The first model waits for more motion, and the samples are kept."""
    fact = Fact(Kind.EFFORT_GAIN, ('iiwa_joint_4',), 'gains disagree', Action.REFUSED)
    whole = job()
    monkeypatch.setattr(first_samples, '_facts_of_arm', lambda job, samples:
                        [fact] if len(samples) == len(whole.rows) else [])
    _, check = first_samples.judged(whole)
    assert not check.passed and check.name == checks.CONVERGED
    assert check.name not in FAULTS
