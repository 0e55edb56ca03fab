"""The share of its cell in which a refined setting lies, against numerical integration."""

from functools import cache

from bench.shared.regression_cases import linear_problem, motion_of_joints, OwnGravity, with_torque
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.regression.candidates import candidates_of
from gravity_comp_ros.regression.refinement import log_volume
from hypothesis import given, strategies as st
import numpy as np
import pytest
from scipy.integrate import quad

CELL = [{'start': 2.0}, {'start': 4.0}]


@given(st.floats(0.005, 0.2), st.floats(2.4, 3.6))
def test_a_best_setting_within_the_cell(std, best):
    def fall(value):
        return 0.5 * ((value - best) / std) ** 2

    near = [(fall(value), {'start': value}) for value in (best - 1e-3, best + 1e-3)]
    mean = quad(lambda value: np.exp(-fall(value)), 2.0, 4.0, points=[best])[0] / 2.0
    assert log_volume({'start': best}, CELL, near) == pytest.approx(np.log(mean), abs=0.05)


@given(st.floats(20.0, 200.0))
def test_a_best_setting_at_a_limit(slope):
    near = [(1e-3 * slope, {'start': 2.001})]
    mean = quad(lambda value: np.exp(-slope * (value - 2.0)), 2.0, 4.0, points=[2.1])[0] / 2.0
    assert log_volume({'start': 2.0}, CELL, near) == pytest.approx(np.log(mean), abs=0.05)


def test_settings_that_the_data_do_not_determine_or_that_are_separate_cost_nothing():
    flat = [(0.0, {'start': 2.999}), (0.0, {'start': 3.001})]
    assert log_volume({'start': 3.0}, CELL, flat) == 0.0
    separate = [(50.0, {'start': 2.0}), (50.0, {'start': 4.0})]
    assert log_volume({'start': 3.0}, CELL, separate) == 0.0
    assert log_volume({'side': 1.0}, [], []) == 0.0
    assert np.isfinite(log_volume({'start': 3.0}, CELL, [(np.inf, {'start': 2.999})]))
    # The ends of the cell are outside of the limits.
    assert log_volume({'start': 3.0}, [], flat) == 0.0


def test_each_parameter_counts_for_itself():
    best, cell = {'a': 0.0, 'b': 0.0}, [{'a': -1.0, 'b': 0.0}, {'a': 1.0, 'b': 0.0},
                                        {'a': 0.0, 'b': -2.0}, {'a': 0.0, 'b': 2.0}]
    near = [(2.0, {'a': -0.02, 'b': 0.0}), (2.0, {'a': 0.02, 'b': 0.0})]
    other = [(2.0, {'a': 0.0, 'b': -0.02}), (2.0, {'a': 0.0, 'b': 0.02})]
    alone = log_volume(best, cell, near), log_volume(best, cell, other)
    assert log_volume(best, cell, [*near, *other]) == pytest.approx(sum(alone))
    assert alone[1] == pytest.approx(alone[0] - np.log(2.0))


@cache
def factory():
    shared = OwnGravity(np.array([1.0, 3.0, -2.0, 0.5]))
    samples = with_torque(motion_of_joints(2, 0), lambda q, qd, t: shared.gravity(q), 0)
    return linear_problem(samples, shared)[2]


@pytest.mark.parametrize('name', sorted(all_effects()))
def test_first_neighbours_of_a_setting_differ_in_one_parameter(name):
    """The cell of a setting is known from them."""
    candidates = candidates_of(factory(), [all_effects()[name]])
    for term in [t for part in (*candidates.of_joint, candidates.of_arm) for t in part]:
        for end in factory().cell(term):
            changed = [k for k, v in end.items() if v != term.setting.get(k)]
            assert len(changed) <= 1, (term.setting, end)
