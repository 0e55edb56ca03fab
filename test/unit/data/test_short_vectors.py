"""Fast checks of short vectors agree with numpy."""

from gravity_comp_ros.data.short_vectors import all_finite, Bounds
from hypothesis import given, strategies as st
import numpy as np

ANY = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(ANY, max_size=9))
def test_all_finite_agrees_with_numpy(values):
    values = np.array(values)
    assert all_finite(values) == np.isfinite(values).all()


@given(st.integers(0, 9).flatmap(lambda n: st.tuples(
    st.lists(ANY, min_size=n, max_size=n),
    st.lists(st.floats(1e-6, 1e6), min_size=n, max_size=n))))
def test_bounds_agree_with_numpy(given_both):
    values, highest = (np.array(part) for part in given_both)
    assert Bounds(highest).contain(values) == (np.abs(values) <= highest).all()


def test_huge_numbers_are_finite_and_nan_is_out_of_bounds():
    assert all_finite(np.full(3, 1e300))
    assert not Bounds(np.full(2, 1e300)).contain(np.array([0.0, np.nan]))
    assert not Bounds(np.array([1.0, 2.0])).contain(np.array([1.0 + 1e-12, 0.0]))
