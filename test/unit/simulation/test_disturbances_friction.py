"""Friction by load, temperature and direction, and of a shared gear."""

from gravity_comp_ros.simulation.arms import iiwa7
from gravity_comp_ros.simulation.disturbances.friction import (
    DifferentialFriction, Friction, LoadFriction, LuGre, ThermalFriction)
from gravity_comp_ros.simulation.motions import eq17, multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pytest

ARM = iiwa7()


def motion_of(rate=100.0, duration=60.0, seed=1):
    return multisine(ARM.lower, ARM.upper, ARM.max_speed, seed, MultisineOptions(max_speed=0.3),
                     duration, rate)


def added(disturbance, motion, load=None):
    """Return the torque (M, N) that a disturbance adds to `load`."""
    load = np.zeros_like(motion.q) if load is None else load
    out = disturbance.apply(Signals(motion.q, motion.qd, load), motion, ARM,
                            np.random.default_rng(0))
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


@pytest.mark.parametrize('shafts', [(LuGre(0.3), None), (LuGre(0.3, 0.2), LuGre(0.1, 0.4)),
                                    (None, LuGre(0.2))])
def test_a_differential_dissipates_the_power_of_its_shafts(shafts):
    motion = motion_of()
    torque = added(DifferentialFriction((4, 5), *shafts), motion)
    assert not np.delete(torque, [4, 5], axis=1).any()
    va, vb = motion.qd[:, 4], motion.qd[:, 5]
    power = (torque * motion.qd).sum(axis=1)
    lost = np.zeros_like(power)
    for speed, surfaces in zip((va + vb, vb - va), shafts):
        if surfaces is not None:
            lost += (surfaces.coulomb * np.sign(speed) + surfaces.viscous * speed) * speed
    sliding = np.minimum(np.abs(va + vb), np.abs(vb - va)) > 0.04
    assert power[sliding] == pytest.approx(lost[sliding], rel=0.02, abs=1e-4)
    assert power[sliding].min() >= 0
