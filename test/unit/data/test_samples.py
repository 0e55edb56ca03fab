"""JointSamples: validation, immutability, selection and concatenation."""

from dataclasses import FrozenInstanceError

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.data.runs import (
    blocks_to_hold_out, GUARD, MAX_PAUSE, run_time, session_time, within)
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from hypothesis import given, strategies as st
import numpy as np
import pytest

NAMES = ('a', 'b', 'c')


def some(count: int = 5, names=NAMES, label: str = 'run', seed: int = 0) -> JointSamples:
    rng = np.random.default_rng(seed)
    n = len(names)
    return JointSamples.single_run(names, np.arange(count) * 0.1, rng.normal(size=(count, n)),
                                   rng.normal(size=(count, n)), rng.normal(size=(count, n)),
                                   label)


def fields(samples: JointSamples) -> dict:
    return {key: getattr(samples, key) for key in
            ('names', 't', 'q', 'qd', 'tau', 'runs', 'run_labels')}


def edited(**changes) -> JointSamples:
    return JointSamples(**{**fields(some()), **changes})


def with_value(field: str, place, value) -> np.ndarray:
    array = getattr(some(), field).copy()
    array[place] = value
    return array


@pytest.mark.parametrize('changes, message', [
    ({'names': ()}, 'no joints'),
    ({'names': ('a', 'b', 'a')}, 'joint names repeat: a'),
    ({'names': ('a', 'b')}, r'q has shape \(5, 3\); expected \(5, 2\)'),
    ({'t': np.zeros((5, 1))}, 't has shape'),
    ({'q': np.zeros((4, 3))}, r'q has shape \(4, 3\)'),
    ({'qd': np.zeros(5)}, r'qd has shape \(5,\)'),
    ({'tau': np.zeros((5, 3, 1))}, 'tau has shape'),
    ({'runs': np.zeros(4, dtype=int)}, 'runs has shape'),
    ({'runs': np.array([0, 0, 1, 0, 0]), 'run_labels': ('x', 'y')}, 'run numbers must rise'),
    ({'runs': np.array([-1, 0, 0, 0, 0])}, 'run numbers must rise'),
    ({'runs': np.array([0, 0, 0, 0, 1])}, 'stay under the 1 run labels'),
    ({'t': with_value('t', 3, np.nan)}, 't is not finite at sample 3'),
    ({'q': with_value('q', (2, 1), np.inf)}, 'q of joint b is not finite at sample 2'),
    ({'qd': with_value('qd', (0, 0), np.nan)}, 'qd of joint a is not finite at sample 0'),
    ({'tau': with_value('tau', (4, 2), -np.inf)}, 'tau of joint c is not finite at sample 4'),
    ({'t': np.array([0.0, 0.1, 0.1, 0.2, 0.3])}, r'time does not increase at sample 2 \(run r'),
    ({'t': np.array([0.0, 0.1, 0.2, 0.3, 0.2])}, 'time does not increase at sample 4'),
])
def test_invalid_samples_are_refused_in_one_line(changes, message):
    with pytest.raises(DataError, match=message) as caught:
        edited(**changes)
    assert '\n' not in str(caught.value)


def test_time_may_start_again_with_a_run_and_a_run_may_be_empty():
    samples = edited(t=[0.0, 0.1, 0.0, 0.1, 0.2], runs=[0, 0, 1, 1, 1], run_labels=('x', 'y'))
    assert [part.n_samples for part in samples.each_run()] == [2, 3]
    empty = some(0)
    assert len(empty) == 0 and empty.q.shape == (0, 3)
    assert [len(part) for part in concatenate([empty, some(2)]).each_run()] == [0, 2]


@pytest.mark.parametrize('field', ['t', 'q', 'qd', 'tau', 'runs'])
def test_arrays_cannot_be_edited(field):
    samples = some()
    with pytest.raises(ValueError, match='read-only'):
        getattr(samples, field)[0] = 1
    with pytest.raises(FrozenInstanceError):
        setattr(samples, field, None)


@pytest.mark.parametrize('writeable', [True, False])
def test_an_array_or_view_of_the_caller_is_copied(writeable):
    q = np.zeros((2, 1))
    view = q.view()
    view.flags.writeable = writeable
    samples = JointSamples.single_run(['x'], [0.0, 1.0], view, view, view)
    q[0] = 7.0
    assert q.flags.writeable and samples.q[0, 0] == 0.0 and samples.tau[0, 0] == 0.0


def test_select_by_mask_and_by_number():
    samples = some(6)
    mask = np.array([True, False, True, False, False, True])
    for keep in (mask, np.flatnonzero(mask)):
        selected = samples.select(keep)
        np.testing.assert_array_equal(selected.t, samples.t[mask])
        np.testing.assert_array_equal(selected.tau, samples.tau[mask])
        assert selected.run_labels == samples.run_labels
    # A run that loses all samples keeps its label.
    samples = concatenate([some(3, label='x'), some(3, label='y')])
    selected = samples.select(samples.runs == 1)
    assert selected.run_labels == ('x', 'y') and [len(p) for p in selected.each_run()] == [0, 3]


def test_joints_are_selected_and_ordered_by_name():
    samples = some()
    selected = samples.joints(['c', 'a'])
    assert selected.names == ('c', 'a')
    for field in ('q', 'qd', 'tau'):
        np.testing.assert_array_equal(getattr(selected, field),
                                      getattr(samples, field)[:, [2, 0]])
    with pytest.raises(ModelMismatchError, match='no joint z in the data; it has a, b, c'):
        some().joints(['a', 'z'])


def test_concatenate_matches_joints_by_name():
    first, second = some(3, label='x'), some(2, names=('c', 'a', 'b'), label='y', seed=1)
    both = concatenate([first, second])
    assert both.names == NAMES and both.run_labels == ('x', 'y')
    np.testing.assert_array_equal(both.runs, [0, 0, 0, 1, 1])
    np.testing.assert_array_equal(both.q[3:], second.q[:, [1, 2, 0]])
    np.testing.assert_array_equal(both.tau[3:], second.tau[:, [1, 2, 0]])


@pytest.mark.parametrize('names', [('a', 'b'), ('a', 'b', 'd'), ('a', 'b', 'c', 'd')])
def test_runs_of_different_robots_are_refused(names):
    with pytest.raises(ModelMismatchError, match='x and y are of different robots'):
        concatenate([some(2, label='x'), some(2, names=names, label='y')])
    with pytest.raises(DataError, match='no samples to join'):
        concatenate([])


@given(counts=st.lists(st.integers(0, 6), min_size=1, max_size=5))
def test_each_run_reverses_concatenate(counts):
    parts = [some(count, label=f'r{k}', seed=k) for k, count in enumerate(counts)]
    joined = concatenate(parts)
    assert len(joined) == sum(counts)
    for part, again in zip(parts, joined.each_run()):
        assert again.run_labels == part.run_labels
        for field in ('t', 'q', 'qd', 'tau'):
            np.testing.assert_array_equal(getattr(again, field), getattr(part, field))


def runs(*starts, count=5):
    still = np.zeros((count, 1))
    return concatenate([JointSamples.single_run(('a',), np.arange(count) * 0.5, still, still,
                                                still, start=start) for start in starts])


def test_runs_on_one_clock_share_a_time_axis():
    times = session_time(runs(1000.0, 1060.0))
    np.testing.assert_allclose(times, [0, 0.5, 1, 1.5, 2, 60, 60.5, 61, 61.5, 62])
    # In any order of the recordings.
    times = session_time(runs(1060.0, 1000.0))
    np.testing.assert_allclose(times, [60, 60.5, 61, 61.5, 62, 0, 0.5, 1, 1.5, 2])
    # A pause of hours ends a session.
    times = session_time(runs(0.0, 10.0, 20.0 + MAX_PAUSE, 30.0 + MAX_PAUSE))
    np.testing.assert_allclose(times[[0, 5, 10, 15]], [0.0, 10.0, 0.0, 10.0])
    # Selections keep the clock.
    samples = runs(1000.0, 1060.0).select(np.arange(10) % 2 == 1).joints(('a',))
    np.testing.assert_allclose(session_time(samples), [0, 1, 59.5, 60.5, 61.5])
    assert samples.run(1).starts == (1060.0,)


@pytest.mark.parametrize('starts', [(0.0, 0.0), (10.0, 11.0), (None, None), (5.0, None)])
def test_runs_that_overlap_or_have_no_clock_start_at_0(starts):
    samples = runs(*starts)
    np.testing.assert_array_equal(session_time(samples), run_time(samples))


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


def ramp(count: int, label: str = 'run', step: float = 0.2) -> JointSamples:
    t = np.arange(count) * step
    q = np.column_stack([t, -t])
    return JointSamples.single_run(('a', 'b'), t, q, np.zeros_like(q), q, label)


def divided(samples, fraction=0.2, guard=GUARD):
    """Return the blocks, the fitted and the held-out samples."""
    blocks = blocks_to_hold_out(samples, fraction, guard)
    return (blocks, samples.select(~within(samples, blocks, guard)),
            samples.select(within(samples, blocks)))


def test_two_blocks_of_a_single_run_are_held_out():
    # 101 samples over 20 s: a fifth of each half is its last 2 s.
    blocks, fitted, held_out = divided(ramp(101), 0.2, 1.0)
    assert [(b.run, b.start, b.end) for b in blocks] == [
        (0, pytest.approx(8.0), pytest.approx(10.0)),
        (0, pytest.approx(18.0), pytest.approx(20.0))]
    t = held_out.t
    assert set(np.round(t, 6)) == {round(0.2 * k, 6) for k in [*range(40, 51), *range(90, 101)]}
    gaps = np.abs(fitted.t[:, None] - t[None, :]).min(axis=1)
    assert gaps.min() > 1.0


def test_whole_runs_of_several_are_held_out():
    samples = concatenate([ramp(10, f'run{k}') for k in range(5)])
    _, fitted, held_out = divided(samples, 0.4)
    assert set(held_out.runs) == {3, 4} and set(fitted.runs) == {0, 1, 2}
    assert fitted.n_samples == 30
    # A run without samples does not count.
    samples = concatenate([ramp(60, 'first'), ramp(60, 'second')])
    only_first = samples.select(samples.runs == 0)
    blocks, _, held_out = divided(only_first)
    assert 0 < held_out.n_samples < 60 and len(blocks) == 2


@given(count=st.integers(30, 300), fraction=st.floats(0.05, 0.6), guard=st.floats(0, 0.5),
       runs=st.integers(1, 4))
def test_no_sample_is_both_fitted_and_held_out(count, fraction, guard, runs):
    samples = concatenate([ramp(count, str(k)) for k in range(runs)])
    _, *parts = divided(samples, fraction, guard)
    fitted, held_out = (set(zip(part.runs.tolist(), part.t.tolist())) for part in parts)
    assert fitted and held_out and not fitted & held_out


@pytest.mark.parametrize('fraction', [0.0, 1.0, -0.1, float('nan')])
def test_a_fraction_out_of_range_and_too_few_samples_are_refused(fraction):
    with pytest.raises(OptionError, match='fraction'):
        blocks_to_hold_out(ramp(60), fraction)
    with pytest.raises(DataError, match='too few'):
        blocks_to_hold_out(ramp(3), 0.5, 5.0)
