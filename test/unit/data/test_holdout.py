"""Hold-out: held-out samples and those next to them are not fitted."""

from gravity_comp_ros.data.holdout import blocks_to_hold_out, within
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from hypothesis import given, strategies as st
import numpy as np
import pytest


def ramp(count: int, label: str = 'run', step: float = 0.2) -> JointSamples:
    t = np.arange(count) * step
    q = np.column_stack([t, -t])
    return JointSamples.single_run(('a', 'b'), t, q, np.zeros_like(q), q, label)


def divided(samples, *options):
    """Return the blocks, the fitted and the held-out samples."""
    blocks, guarded = blocks_to_hold_out(samples, *options)
    return (blocks, samples.select(~within(samples, guarded)),
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


def test_a_run_without_samples_does_not_count():
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
def test_a_fraction_out_of_range_is_refused(fraction):
    with pytest.raises(OptionError, match='fraction'):
        blocks_to_hold_out(ramp(60), fraction)


def test_too_few_samples_are_refused():
    with pytest.raises(DataError, match='too few'):
        blocks_to_hold_out(ramp(3), 0.5, 5.0)
