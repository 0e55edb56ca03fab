"""Session time: runs with stamps on one clock share a time axis."""

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.runs import MAX_PAUSE, run_time, session_time
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import DataError
import numpy as np
import pytest


def runs(*starts, count=5):
    still = np.zeros((count, 1))
    return concatenate([JointSamples.single_run(('a',), np.arange(count) * 0.5, still, still,
                                                still, start=start) for start in starts])


def test_runs_on_one_clock_share_a_time_axis():
    times = session_time(runs(1000.0, 1060.0))
    np.testing.assert_allclose(times, [0, 0.5, 1, 1.5, 2, 60, 60.5, 61, 61.5, 62])


def test_the_order_of_recordings_does_not_matter():
    times = session_time(runs(1060.0, 1000.0))
    np.testing.assert_allclose(times, [60, 60.5, 61, 61.5, 62, 0, 0.5, 1, 1.5, 2])


@pytest.mark.parametrize('starts', [(0.0, 0.0), (10.0, 11.0), (None, None), (5.0, None)])
def test_runs_that_overlap_or_have_no_clock_start_at_0(starts):
    samples = runs(*starts)
    np.testing.assert_array_equal(session_time(samples), run_time(samples))


def test_a_pause_of_hours_ends_a_session():
    times = session_time(runs(0.0, 10.0, 20.0 + MAX_PAUSE, 30.0 + MAX_PAUSE))
    np.testing.assert_allclose(times[[0, 5, 10, 15]], [0.0, 10.0, 0.0, 10.0])


def test_selections_keep_the_clock():
    samples = runs(1000.0, 1060.0).select(np.arange(10) % 2 == 1).joints(('a',))
    np.testing.assert_allclose(session_time(samples), [0, 1, 59.5, 60.5, 61.5])
    assert samples.run(1).starts == (1060.0,)


def test_starts_that_do_not_fit_the_runs_are_refused():
    still = np.zeros((2, 1))
    for starts in ((1.0, 2.0), (float('nan'),)):
        with pytest.raises(DataError, match='starts'):
            JointSamples(('a',), np.arange(2.0), still, still, still, np.zeros(2, dtype=int),
                         ('r',), starts)


def test_arrays_with_times_on_one_clock_are_a_session():
    still = [np.zeros((5, 1))] * 2
    times = [np.arange(5.0), 100.0 + np.arange(5.0)]
    one = Recording.from_arrays(q=still, tau=[np.ones((5, 1))] * 2, t=times, qd=still)
    np.testing.assert_allclose(session_time(one.samples), np.concatenate(times))
    each = Recording.from_arrays(q=still, tau=[np.ones((5, 1))] * 2, rate=1.0, qd=still)
    np.testing.assert_allclose(session_time(each.samples), [0, 1, 2, 3, 4] * 2)
