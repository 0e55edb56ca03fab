"""The dynamic torque of an arm of unknown lengths, against Pinocchio and by hand."""

from dataclasses import replace

from bench.cases.cases import ARMS
from bench.cases.generated import generated_arm
from fast_arms import drawn, NOISE, of_motion, recording
import gravity_comp_ros as gc
from gravity_comp_ros.data.acceleration import accelerations
from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.effects.arm_dynamics import (
    axis_sign, axis_sign_options, chain_dynamics, with_axis_signs)
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.unknown_lengths import INERTIAS, motion_columns
from gravity_comp_ros.simulation import arms
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from serial_arms import geometry_of

G = STANDARD_GRAVITY


def chain_of(arm):
    """Return the true axes and moments of an arm."""
    axes = geometry_of(arm).rotations
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (300, arm.n_joints))
    columns = ForwardKinematics(axes, q).moment_columns()
    flat = columns.reshape(len(columns), -1).T
    moments = np.linalg.lstsq(flat, arms.gravity_torque(arm, q).T.ravel(), rcond=1e-10)[0]
    return Chain(axes, moments.reshape(-1, 2))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10 ** 6), st.integers(1, 7))
def test_lengths_and_inertias_are_all_that_motion_needs(seed, n):
    # The others of these arms stand on a tilted base, which `geometry_of` leaves out.
    arm = generated_arm(4 * (seed // 4), n)
    q, qd, qdd = drawn(n, 40 * n, seed)
    columns = motion_columns(chain_of(arm), np.ones(n), q, qd, qdd)[:, :, 1:]
    truth = of_motion(arm, q, qd, qdd)
    flat = columns.reshape(truth.size, -1)
    solution = np.linalg.lstsq(flat, truth.ravel(), rcond=1e-10)[0]
    assert np.linalg.norm(truth.ravel() - flat @ solution) < 1e-8 * np.linalg.norm(truth)


def test_a_planar_arm_by_hand():
    # Two horizontal axes 0.7 m apart: a mass of 2 kg at 0.3 m of the first link, of 3 kg at 0.4 m
    # of the second. Link 1 carries 3 kg at its end.
    length, inner, outer = 0.7, 2.0 * 0.3 + 3.0 * 0.7, 3.0 * 0.4
    axes = np.stack([np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), np.eye(3)])
    chain = Chain(axes, G * np.array([[inner, 0.0], [outer, 0.0]]))
    q, qd, qdd = drawn(2, 50, 0)
    columns = motion_columns(chain, np.zeros(2), q, qd, qdd)
    # Izz of each link about its own axis, and the length along x of the first link.
    izz = (2.0 * 0.3 ** 2 + 3.0 * length ** 2, 3.0 * 0.4 ** 2)
    parameters = np.zeros(columns.shape[2])
    parameters[[1, 1 + len(INERTIAS), 2 + len(INERTIAS)]] = [*izz, length]
    cos, sin = np.cos(q[:, 1]), np.sin(q[:, 1])
    both = outer * length
    m11 = izz[0] + izz[1] + 2.0 * both * cos
    m12 = izz[1] + both * cos
    first = m11 * qdd[:, 0] + m12 * qdd[:, 1] - both * sin * (
        2.0 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2)
    second = m12 * qdd[:, 0] + izz[1] * qdd[:, 1] + both * sin * qd[:, 0] ** 2
    assert columns @ parameters == pytest.approx(np.column_stack([first, second]), abs=1e-12)


@pytest.mark.parametrize('seed', [0, 1, 4])
def test_the_nominal_arm_is_physical(seed):
    arm = generated_arm(seed)
    dynamics, n = chain_dynamics(chain_of(arm)), arm.n_joints
    q = np.repeat(drawn(n, 30, seed)[0], n, axis=0)
    masses = dynamics.columns(q, 0.0 * q, np.tile(np.eye(n), (30, 1)))[:, :, 0].reshape(-1, n, n)
    assert masses == pytest.approx(masses.transpose(0, 2, 1), abs=1e-12)
    assert np.linalg.eigvalsh(masses).min() > 0.0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10 ** 6), st.integers(3, 7))
def test_gravity_does_not_show_which_way_a_vertical_axis_turns(seed, n):
    arm = generated_arm(4 * (seed // 4), n)
    chain = chain_of(arm)
    q, speed, rate = drawn(n, 50, seed)
    way = axis_sign(chain)
    assert axis_sign(mirrored(chain)) == way
    assert mirrored(chain).torque(q) == pytest.approx(chain.torque(q), abs=1e-9)
    assert with_axis_signs(chain, (way,)) is chain
    other = with_axis_signs(chain, (-way,))
    assert axis_sign(other) == -way
    # The moment about a vertical axis is free, so that joint is left out.
    assert other.torque(q)[:, 1:] == pytest.approx(chain.torque(q)[:, 1:], abs=1e-9)
    truth = of_motion(arm, q, speed, rate).ravel()
    for one in (chain, mirrored(chain)):
        flat = chain_dynamics(one).columns(q, speed, rate).reshape(len(truth), -1)
        solution = np.linalg.lstsq(flat, truth, rcond=1e-10)[0]
        assert np.linalg.norm(truth - flat @ solution) < 1e-8 * np.linalg.norm(truth)


def test_two_vertical_axes_turn_each_its_own_way():
    # As in a SCARA, the second axis is parallel to the first.
    arm = ARMS['right_six']()
    chain = chain_of(arm)
    q, speed, rate = drawn(6, 300, 1)
    truth = of_motion(arm, q, speed, rate).ravel()
    every, right = axis_sign_options(chain, q), (axis_sign(chain), axis_sign(chain, 1))
    assert len(every) == 4 and right in every
    for start in (*(with_axis_signs(chain, signs) for signs in every), mirrored(chain)):
        assert start.torque(q)[:, 2:] == pytest.approx(chain.torque(q)[:, 2:], abs=1e-9)
        for signs in every:
            flat = chain_dynamics(start, signs).columns(q, speed, rate).reshape(len(truth), -1)
            residual = truth - flat @ np.linalg.lstsq(flat, truth, rcond=1e-10)[0]
            share = np.linalg.norm(residual) / np.linalg.norm(truth)
            assert (share < 1e-8) == (signs == right), (signs, share)


def test_a_horizontal_second_axis_has_no_way_of_its_own():
    chain, q = chain_of(ARMS['six_axis']()), drawn(6, 50, 0)[0]
    assert axis_sign_options(chain, q) == [(1.0,), (-1.0,)]
    assert axis_sign_options(Chain(chain.axes, 0.0 * chain.moments + 1.0), q[:0]) == [()]


def mirrored(chain):
    """Return the mirror image of a chain: gravity upside down, and opposite moments."""
    axes = chain.axes.copy()
    axes[0] = np.diag([1.0, -1.0, -1.0]) @ axes[0]
    return Chain(axes, -chain.moments)


@pytest.mark.parametrize('seed', [0, 4, 8])
def test_motion_shows_which_way_a_vertical_axis_turns(seed):
    arm = generated_arm(seed, 5)
    chain = chain_of(arm)
    samples = recording(arm, seed, 20.0, 50.0)
    model = fit(samples, FitOptions('chain')).model
    effect, signs = known_effect('rigid_body_dynamics'), []
    for start in (with_axis_signs(chain, (1.0,)), with_axis_signs(chain, (-1.0,))):
        motion = build_motion(samples, replace(model, chain=start))
        setting, = effect.settings(motion, 0)
        signs.append(setting['way'])
        columns = effect.columns(motion, 0, setting)
        assert columns.shape[2] == len(effect.coefficients_of(motion, 0, setting))
    # Whichever way the chain came out, the dynamics are those of the arm.
    assert signs == [axis_sign(chain)] * 2


@pytest.mark.parametrize('arm, seed', [('iiwa7', 2), ('six_axis', 2), ('right_seven', 1)])
def test_dynamics_that_are_added_are_those_of_the_arm(arm, seed):
    arm = ARMS[arm]()
    runs = concatenate([recording(arm, 10 * seed + k, 40.0, 50.0) for k in range(3)])
    data = gc.Recording(runs, gate=None)
    friction = [f'{name}:{joint}' for joint in arm.joints
                for name in ('coulomb_friction', 'viscous_friction')]
    model = gc.Model(fit(runs, FitOptions('chain')).model)
    added = gc.add_effects(model, data,
                           ['rigid_body_dynamics', *friction], all_samples=True)
    later = recording(arm, 10 * seed + 9, 20.0, 50.0)
    qdd = accelerations(later)
    truth = of_motion(arm, later.q, later.qd, qdd)
    moving = [e for e in added.gravity.applied.effects if e.name == 'rigid_body_dynamics']
    alone = replace(added.gravity, applied=replace(added.gravity.applied, effects=tuple(moving)))
    error = (effect_torque(alone, later) - truth).std(axis=0)
    assert (error < 0.1 * truth.std(axis=0).max()).all(), (error, truth.std(axis=0))


def test_parts_of_a_motion_have_the_columns_of_the_whole():
    dynamics = chain_dynamics(chain_of(arms.iiwa7()))
    one, two = drawn(7, 3000, 1), drawn(7, 5, 2)
    both = tuple(np.concatenate(pair) for pair in zip(one, two))
    parts = np.concatenate([dynamics.columns(*one), dynamics.columns(*two)])
    assert np.abs(dynamics.columns(*both) - parts).max() < 1e-12
    assert parts.shape[2] == len(dynamics.prior_std) == len(dynamics.coefficients())


@pytest.mark.parametrize('formulation', ['auto', 'potential'])
def test_fast_motion_of_an_arm_without_a_description_is_explained(formulation):
    arm = generated_arm(22, 4)
    runs = concatenate([recording(arm, k, 15.0, 50.0) for k in range(2)])
    data = gc.Recording(runs, gate=None)
    model = gc.fit(data, formulation=formulation)
    findings = gc.diagnose(data, model).findings
    accepted = [f for f in findings if f.verdict in (gc.Verdict.ESTABLISHED, gc.Verdict.LIKELY)]
    names = {f.effect for f in accepted}
    assert {'rigid_body_dynamics', 'coulomb_friction'} <= names
    assert names <= {'rigid_body_dynamics', 'coulomb_friction', 'viscous_friction'}
    better = gc.add_effects(model, data, accepted, all_samples=True)
    later = gc.Recording(recording(arm, 90, 15.0, 50.0), gate=None)
    before, after = (gc.compare(m, later).joints for m in (model, better))
    for name in before:
        assert before[name].rmse > 5.0 * NOISE
        assert after[name].rmse < 2.0 * NOISE
