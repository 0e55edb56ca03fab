"""Epoch: held-out samples, due fits, closing."""

from bench.shared.node_messages import slow_sample
from gravity_comp_ros.node import epoch as epoch_module
from gravity_comp_ros.node.epoch import Epoch
from gravity_comp_ros.node.parameters import Parameters
import numpy as np

OPTIONS = Parameters(min_samples=15, first_samples=15, full_samples=60)


def feed(epoch, n, start=0, step=0.05, still=False):
    for k in range(start, start + n):
        q = np.array([step * k, 0.0 if still else -step * k])
        epoch.offer(slow_sample(0.2 * k, q, np.zeros(2), q, float(k)))


def test_every_fourth_block_is_held_out():
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    feed(epoch, 40)
    rows, held_out = epoch.rows(), [15, 16, 17, 18, 19, 35, 36, 37, 38, 39]
    np.testing.assert_array_equal(np.flatnonzero(rows.held_out), held_out)
    np.testing.assert_allclose(rows.samples.q[:, 0], 0.05 * np.arange(40))
    assert epoch.n_held_out == 10 and len(epoch) == 40 and len(rows.train) == 30
    # Each sample keeps the torque that was published before it.
    np.testing.assert_array_equal(rows.sent[:, 3, 1], np.arange(40.0))


def test_a_clock_that_starts_again_begins_a_run():
    """Samples of two passes over the same stamps, as of a recording that is played twice."""
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    feed(epoch, 30)
    for k in range(30):
        epoch.offer(slow_sample(0.2 * k + 0.05, np.array([0.3, 0.02 * k]), np.ones(2), np.ones(2),
                                float(k)))
    rows = epoch.rows()
    assert len(rows) == 60 and rows.samples.n_runs == 2
    np.testing.assert_allclose(rows.samples.t[:30], 0.2 * np.arange(30))
    np.testing.assert_array_equal(rows.sent[:, 0, 0], np.tile(np.arange(30.0), 2))


def test_it_reports_what_is_missing_for_a_fit():
    epoch = Epoch(3, ['a', 'b'], OPTIONS)
    assert 'no slow samples' in epoch.missing_for_fit()
    feed(epoch, 10)
    assert '10 training and 0 held-out samples' in epoch.missing_for_fit()
    still = Epoch(3, ['a', 'b'], OPTIONS)
    feed(still, 20, step=0.002)
    assert 'no joint has moved' in still.missing_for_fit()
    assert still.describe() == ('epoch 3 open, 20 of 60 samples (5 held out), too little range '
                                'on a, b')


def test_after_broken_effort_it_requires_more_samples():
    options = Parameters(min_samples=15, first_samples=45, full_samples=60)
    # With ten of 55 samples held out.
    for broken, needed in ((False, 20), (True, 55)):
        epoch = Epoch(0, ['a', 'b'], options, has_base=True)
        if broken:
            epoch.restart_after_broken_effort()
        assert due_fits(epoch, 80, True)[0] == needed
        epoch.restart()
        feed(epoch, 10)
        assert ('after broken effort' in epoch.missing_for_fit()) == broken


def due_fits(epoch, n, succeed, still=False):
    """Offer n samples, and end each fit that is due; return the numbers of samples of the fits."""
    due = []
    for k in range(n):
        feed(epoch, 1, k, still=still)
        if epoch.fit_is_due():
            due.append(k + 1)
            epoch.fit_started()
            assert not epoch.fit_is_due()
            epoch.fit_ended(succeed)
    return due


def test_fits_are_due_as_samples_grow_and_the_last_closes_the_epoch():
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    assert due_fits(epoch, 90, True) == [20, 25, 32, 40, 50, 60]
    # A closed epoch collects samples for fits on request.
    assert not epoch.is_open and len(epoch) == 90 and epoch.missing_for_fit() is None
    # A joint without range keeps it open.
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    due_fits(epoch, 90, True, still=True)
    assert epoch.is_open and epoch.short_of_range() == ('b',)


def test_a_failed_fit_does_not_close_the_epoch_and_is_repeated_with_more_samples():
    """An effect that the motion does not excite fails each time."""
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    due = due_fits(epoch, 2 * epoch_module.CAPACITY, False)
    assert epoch.is_open and due[:8] == [20, 25, 32, 40, 50, 60, 75, 94]
    # Also with a full ring, whose number of samples does not grow.
    assert due[-1] > epoch_module.CAPACITY and len(epoch) == epoch_module.CAPACITY
