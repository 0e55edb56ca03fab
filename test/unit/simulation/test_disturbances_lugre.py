"""LuGre friction: steady state, energy, and comparison with a general integrator."""

from dataclasses import replace

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.disturbances.friction import deflection, friction_torque, LuGre
from hypothesis import given, strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

SURFACES = LuGre(1.5, viscous=2.0, static=2.7, stribeck_speed=0.03)


def at_speed(v, duration=2.0, step=0.005):
    t = np.arange(0.0, duration, step)
    return t, v * t, np.full_like(t, v)


@pytest.mark.parametrize('v', [-0.3, -0.03, 0.001, 0.02, 0.2])
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


@given(st.lists(st.floats(-0.1, 0.1), min_size=1, max_size=50), st.floats(1e-4, 1e-1))
def test_deflection_never_exceeds_slip(moves, slip):
    z = deflection(np.array(moves), np.full(len(moves), slip))
    assert len(z) == len(moves) + 1
    assert np.abs(z).max() <= slip * (1 + 1e-12)
