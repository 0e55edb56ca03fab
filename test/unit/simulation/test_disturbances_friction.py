"""Friction by load, temperature and direction, and of a shared gear."""

from dataclasses import replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import iiwa7
from gravity_comp_ros.simulation.disturbances.friction import (
    DifferentialFriction, Friction, friction_torque, LoadFriction, LuGre, ThermalFriction)
from gravity_comp_ros.simulation.motions import eq17, multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import Signals
from hypothesis import given, strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

ARM = iiwa7()


def motion_of(rate=100.0, duration=60.0, seed=1):
    return multisine(ARM.lower, ARM.upper, ARM.max_speed, seed, MultisineOptions(max_speed=0.3),
                     duration, rate)


def added(disturbance, motion, load=None):
    """Return the torque (M, N) that a disturbance adds to `load`."""
    load = np.zeros_like(motion.q) if load is None else load
    out = disturbance.apply(Signals(motion.q, motion.qd, load), motion, ARM)
    assert np.array_equal(out.q, motion.q)
    return out.tau - load


def test_friction_acts_on_its_joint_only_and_against_the_motion():
    motion = motion_of()
    torque = added(Friction(3, LuGre(0.8, 2.0)), motion)
    assert not np.delete(torque, 3, axis=1).any()
    sliding = np.abs(motion.qd[:, 3]) > 0.02
    expected = 0.8 * np.sign(motion.qd[:, 3]) + 2.0 * motion.qd[:, 3]
    assert torque[sliding, 3] == pytest.approx(expected[sliding], abs=0.05)


def test_friction_does_not_depend_on_the_sample_rate():
    fine, coarse = (added(Friction(1, LuGre(1.0, 1.0, 2.0)), eq17(100.0, rate))[:, 1]
                    for rate in (200.0, 5.0))
    # 40 samples of one are one step of the other; both integrate in steps of 5 ms.
    assert coarse == pytest.approx(fine[::40], abs=1e-9)


def test_load_friction_is_a_fraction_of_load_and_preload():
    motion = motion_of()
    sliding = np.abs(motion.qd[:, 1]) > 0.05
    for load, level in ((0.0, 0.05 * 3.0), (4.0, 0.05 * 5.0), (80.0, 0.05 * np.hypot(3, 80))):
        torque = added(LoadFriction(1, 0.05, 3.0), motion, np.full_like(motion.q, load))[:, 1]
        assert np.abs(torque[sliding]) == pytest.approx(level, rel=1e-2)
        assert (np.sign(torque) == np.sign(motion.qd[:, 1]))[sliding].all()


def test_a_gear_warms_to_thermal_equilibrium():
    warm = ThermalFriction(1, LuGre(2.0), idle=3.0, resistance=6.0, capacity=12.0, softening=0.0)
    t = np.arange(0.0, 800.0, 0.01)
    temperature = warm.temperature(t, np.full(len(t), 0.5))
    assert temperature[0] == 22.0
    assert temperature[-1] == pytest.approx(22.0 + 6.0 * 3.5, abs=0.01)
    after = np.searchsorted(t, 72.0)
    assert temperature[after] == pytest.approx(22.0 + 21.0 * (1 - np.exp(-1)), abs=0.01)


def test_viscosity_is_given_cold_and_falls_with_temperature():
    warm = ThermalFriction(1, LuGre(2.0, 6.0))
    at = np.array([22.0, 32.0, 60.0])
    assert warm.viscosity_factor(at)[0] == 1.0
    assert (np.diff(warm.viscosity_factor(at)) < 0).all()
    # Vogel's law: exp(900 / 155 - 900 / 117).
    assert warm.viscosity_factor(at)[2] == pytest.approx(np.exp(900 / 155 - 900 / 117))
    assert warm.dry_factor(at) == pytest.approx([1.0, 0.85, 0.43])


def test_a_differential_dissipates_the_power_of_its_shaft():
    motion, surfaces = motion_of(), LuGre(0.3, 0.2)
    torque = added(DifferentialFriction((4, 5), surfaces), motion)
    assert not np.delete(torque, [4, 5], axis=1).any()
    speed = motion.qd[:, 4] + motion.qd[:, 5]
    power = (torque * motion.qd).sum(axis=1)
    lost = (0.3 * np.sign(speed) + 0.2 * speed) * speed
    sliding = np.abs(speed) > 0.04
    assert power[sliding] == pytest.approx(lost[sliding], rel=0.02, abs=1e-4)
    assert power[sliding].min() >= 0


SURFACES = LuGre(1.5, viscous=2.0, static=2.7, stribeck_speed=0.03)


def at_speed(v, duration=2.0, step=0.005):
    t = np.arange(0.0, duration, step)
    return t, v * t, np.full_like(t, v)


@pytest.mark.parametrize('v', [-0.3, 0.001, 0.02])
def test_steady_sliding_follows_the_stribeck_curve(v):
    torque = friction_torque(*at_speed(v, 10.0), SURFACES)[-1]
    # Analytically: level (1 + (2.7 / 1.5 - 1) / (1 + (v / 0.03)^2)), and the viscous part.
    expected = np.sign(v) * (1.5 + 1.2 / (1 + (v / 0.03) ** 2)) + 2.0 * v
    assert torque == pytest.approx(expected, rel=1e-6)


def test_agrees_with_a_general_integrator():
    def speed(t):
        return 0.1 * np.sin(3 * t)

    def rate(t, z):
        v = speed(t)
        level = 1.5 + 1.2 / (1 + (v / 0.03) ** 2)
        return v - 7500.0 * abs(v) / level * z

    t = np.arange(0.0, 3.0, 2e-4)
    z = solve_ivp(rate, (0, 3), [0.0], t_eval=t, rtol=1e-8, atol=1e-12, max_step=1e-3,
                  method='LSODA').y[0]
    reference = 7500.0 * z + 15.0 * np.array([rate(a, b) for a, b in zip(t, z)]) + 2.0 * speed(t)
    torque = friction_torque(t, 0.1 / 3 * (1 - np.cos(3 * t)), speed(t), SURFACES)
    assert np.abs(torque - reference).max() < 0.02


def test_two_directions_have_their_own_level():
    forward = LuGre(1.0, 1.0)
    backward = replace(forward.at_level(0.4), viscous=3.0)
    assert friction_torque(*at_speed(0.1), forward, backward)[-1] == pytest.approx(1.1)
    assert friction_torque(*at_speed(-0.1), forward, backward)[-1] == pytest.approx(-0.7)
    with pytest.raises(OptionError, match='one stiffness'):
        friction_torque(*at_speed(0.1), forward, LuGre(0.4))


@given(st.integers(0, 2 ** 31), st.floats(0.1, 5.0), st.floats(1e-4, 1e-2), st.floats(0.2, 5.0))
def test_friction_is_passive_on_a_closed_path(seed, level, presliding, ratio):
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 10, 4001)
    q = 0.3 * np.sin(np.outer(t, 2 * np.pi * np.arange(1, 4) / 10)) @ rng.standard_normal(3)
    v = np.gradient(q, t)
    surfaces = LuGre(level, 0.5, 2 * level, presliding=presliding)
    torque = friction_torque(t, q, v, surfaces, surfaces.at_level(ratio * level))
    # Only the energy stored in the bristles at the end may be missing.
    stored = 0.5 * surfaces.stiffness * (3 * max(1.0, ratio) * presliding) ** 2
    assert trapezoid(torque * v, t) > -stored


def test_slow_grease_is_viscous_and_fast_grease_grows_with_the_logarithm():
    def torque(speed, coulomb=0.0):
        return friction_torque(*at_speed(speed), LuGre(coulomb, 40.0, thinning=0.05))[-1]

    assert torque(0.001) == pytest.approx(40.0 * 0.001, rel=1e-3)
    assert torque(2.0) - torque(1.0) == pytest.approx(2.0 * np.log(2.0), rel=1e-3)
    assert torque(-0.5) == pytest.approx(-torque(0.5))
    assert torque(0.3, 1.5) - torque(0.3) == pytest.approx(1.5, rel=1e-3)
