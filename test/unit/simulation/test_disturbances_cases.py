"""Recordings of the hidden-effect cases: content and repeatability."""

from dataclasses import replace

from bench.cases.case_list import case, cases, ROLES
from bench.cases.cases import ARMS, Case, recordings, undisturbed
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import gravity_torque, inverse_dynamics
from gravity_comp_ros.simulation.hidden import noise_levels
from gravity_comp_ros.simulation.motions import sample, sines
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pytest

SHORT = {'runs': 2, 'duration': 40.0}


def short(name, arm='iiwa7'):
    return replace(case(arm, name), **SHORT)


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


@pytest.mark.parametrize('arm', sorted(ROLES))
def test_names_are_unique_and_joints_exist(arm):
    names = [entry.name for entry in cases(arm)]
    assert len(set(names)) == len(names) >= 20
    for entry in cases(arm):
        for _, joint in entry.expected | entry.allowed:
            assert joint is None or 0 <= joint < ROLES[arm].count


def test_five_runs_of_150_s_at_50_hz():
    samples = recordings(case('iiwa7', 'coulomb_large'))
    assert samples.n_runs == 5 and len(samples) == 5 * 150 * 50
    assert np.diff(samples.run(0).t) == pytest.approx(0.02)
    assert 0.33 < np.abs(samples.qd).max() < 0.36


def test_every_run_has_reversals_and_rests():
    samples = recordings(case('iiwa7', 'nothing_white'))
    for run in samples.each_run():
        moving = np.abs(run.qd) > 5e-3
        for joint in range(run.n_joints):
            sign = np.sign(run.qd[moving[:, joint], joint])
            assert (np.diff(sign) != 0).sum() >= 5
        assert (~moving.any(axis=1)).mean() > 0.02


def test_the_same_seed_repeats_and_another_does_not():
    first, again = recordings(short('warming'), 3), recordings(short('warming'), 3)
    other = recordings(short('warming'), 4)
    assert np.array_equal(first.tau, again.tau) and np.array_equal(first.q, again.q)
    assert not np.allclose(first.q, other.q)


def test_runs_differ_in_motion():
    samples = recordings(short('nothing_white'))
    assert not np.allclose(samples.run(0).q, samples.run(1).q)


def test_the_noise_has_the_stated_level():
    # The last joint of the iiwa has no gravity torque, only noise and 0.1 mN·m of inertia.
    run = recordings(replace(case('iiwa7', 'nothing_white'), runs=1))
    assert noise_levels(ARMS['iiwa7']()) == (0.1,) * 4 + (0.03,) * 3
    assert run.tau[:, 6].std() == pytest.approx(0.03, rel=0.03)


def test_the_torque_includes_inertia():
    run = recordings(replace(case('six_axis', 'nothing_white'), runs=1))
    arm, step = ARMS['six_axis'](), 0.1
    q, qd = run.q[::5], np.gradient(run.q[::5], step, axis=0)
    qdd = np.gradient(qd, step, axis=0)
    rigid = inverse_dynamics(arm, q, qd, qdd)
    rest = (run.tau[::5] - rigid)[5:-5]
    assert rest.std(axis=0) == pytest.approx(noise_levels(arm), rel=0.15)
    gravity = inverse_dynamics(arm, q, 0 * qd, 0 * qdd)
    assert (run.tau[::5] - gravity)[5:-5].std(axis=0)[1] > 0.2


def test_correlated_noise_is_correlated_and_white_noise_is_not():
    def neighbours(name):
        noise = recordings(replace(case('iiwa7', name), runs=1)).tau[:, 6]
        return np.corrcoef(noise[1:], noise[:-1])[0, 1]
    assert abs(neighbours('nothing_white')) < 0.05
    assert neighbours('nothing_correlated') > 0.8


def test_one_way_moves_in_one_direction_in_every_run():
    entry = case('iiwa7', 'one_way')
    samples = recordings(entry)
    assert samples.qd[:, entry.one_way].min() > 0
    arm = ARMS['iiwa7']()
    assert (samples.q <= arm.upper + 1e-5).all() and (samples.q >= arm.lower - 1e-5).all()


def test_velocity_is_the_derivative_of_position():
    run = recordings(replace(case('iiwa7', 'one_way'), runs=1))
    slope = np.gradient(run.q, run.t, axis=0)
    assert np.abs(slope - run.qd).max() < 0.005


@pytest.mark.parametrize('bad', [{'arm': 'puma'}, {'verdict': 'maybe'}, {'runs': 0}])
def test_invalid_cases_are_refused(bad):
    with pytest.raises(OptionError):
        Case(**{'name': 'x', 'arm': 'iiwa7', **bad})
    with pytest.raises(OptionError):
        case('iiwa7', 'no such case')
