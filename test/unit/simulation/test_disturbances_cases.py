"""Recordings of the hidden-effect cases: content and repeatability."""

from dataclasses import replace

from bench.cases.case_list import case, cases, ROLES
from bench.cases.cases import ARMS, recordings, undisturbed
from gravity_comp_ros.simulation.arms import gravity_torque
from gravity_comp_ros.simulation.motions import sample, sines
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pytest

pytestmark = pytest.mark.campaign


def sweep(arm):
    """Return 40 s in which every joint moves back and forth through 95 % of its range."""
    omega = 2 * np.pi * np.arange(1, arm.n_joints + 1) / 40.0
    middle, half = 0.5 * (arm.upper + arm.lower), 0.475 * (arm.upper - arm.lower)
    return sample('sweep', sines(half, omega, 0.0, middle), 40.0, 20.0)


def changes(entry, arm, motion):
    """Return the largest change of each joint, in q or tau, by the disturbances of a case."""
    still = Signals(motion.q, motion.qd, gravity_torque(arm, motion.q))
    signals, rng = still, np.random.default_rng(0)
    for disturbance in (*entry.disturbances, *(d for _, d in entry.in_run)):
        signals = disturbance.apply(signals, motion, arm, rng)
    return (np.abs(signals.tau - still.tau) + np.abs(signals.q - still.q)).max(axis=0)


@pytest.mark.parametrize('arm_name', sorted(ROLES))
def test_every_case_changes_the_signals_of_its_joints(arm_name):
    arm = ARMS[arm_name]()
    motion = sweep(arm)
    for entry in cases(arm_name):
        hidden = changes(entry, arm, motion)
        if not entry.disturbances and not entry.in_run:
            assert entry.verdict == 'nothing'
        for truth in entry.truths:
            joint = slice(None) if truth.joint is None else truth.joint
            assert np.max(hidden[joint]) > 1e-3, (entry.name, truth)


@pytest.mark.parametrize('arm_name', sorted(ROLES))
def test_motion_and_noise_do_not_depend_on_disturbances(arm_name):
    entry = replace(case(arm_name, 'payload_half_way'), runs=3, duration=90.0)
    disturbed, plain = recordings(entry), recordings(undisturbed(entry))
    assert np.array_equal(disturbed.q, plain.q) and np.array_equal(disturbed.qd, plain.qd)
    different = np.abs(disturbed.tau - plain.tau).max(axis=1) > 1e-6
    # Attached 75 s into the third run.
    assert not different[disturbed.runs < 2].any()
    last, late = disturbed.runs == 2, disturbed.t >= 75.0
    assert different[last & late].all() and not different[last & ~late].any()
