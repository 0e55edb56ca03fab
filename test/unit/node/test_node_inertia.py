"""Inertia in the node: samples wait for later messages, which determine their acceleration."""

from dataclasses import replace

from bench.shared.node_messages import play, slow_sample
from gravity_comp_ros.data.differentiation import with_accelerations
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.node.epoch import DelayedSamples, Epoch, MEAN_OVER, REST_SPEED, rows_of
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import iiwa7, inverse_dynamics
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = iiwa7()


def recorded(seed, seconds=60.0, rate=50.0):
    """Return slow motion with all rigid-body torque and 0.1 N·m of noise."""
    motion = motions.multisine(ARM.lower, ARM.upper, ARM.max_speed, seed,
                               motions.MultisineOptions(0.12), seconds, rate)
    return synthesise(ARM, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed))


def test_samples_of_the_node_are_means_of_the_recording(live):
    node, samples = live(auto_fit=False, settle_time=0.0), recorded(60, 20.0)
    play(node, samples)
    learned = rows_of(node.arm.joints, node.arm.epoch.samples()).samples
    whole = with_accelerations(samples, samples)
    # The last sample has no messages after it, and the arm is at rest at the start.
    assert 90 < len(learned) < len(slow_samples(samples).samples)
    assert (np.abs(np.diff(learned.q, axis=0)).max(axis=1) >= NODE.min_motion).all()
    for k in range(1, len(learned)):
        t = learned.t[k] - 1.0
        near = whole.select(np.abs(whole.t - t) <= 0.5 * MEAN_OVER + 1e-6)
        reverses = ((near.qd > REST_SPEED).any(axis=0) & (near.qd < -REST_SPEED).any(axis=0)).any()
        middle = whole.select(np.abs(whole.t - t) < 1e-6)
        expected = middle if reverses else near
        np.testing.assert_allclose(learned.tau[k], expected.tau.mean(axis=0))
        np.testing.assert_allclose(learned.q[k], expected.q.mean(axis=0))
        np.testing.assert_allclose(learned.qdd[k], middle.qdd[0], atol=3e-4)
    # The first sample has messages on one side only, so its acceleration is unknown.
    assert not learned.qdd[0].any()


def test_a_slow_rate_has_no_accelerations(live):
    node = live(auto_fit=False, settle_time=0.0)
    play(node, recorded(60, 20.0, 10.0))
    kept = node.arm.epoch.samples()
    assert len(kept) > 80 and rows_of(node.arm.joints, kept).samples.qdd is None


def test_a_clock_that_starts_again_and_a_new_payload_drop_waiting_samples(live):
    node, samples = live(auto_fit=False, settle_time=0.0), recorded(60, 3.0)
    now = play(node, samples)
    node.learner.payload_changed(now)
    assert len(node.arm.epoch) == 0
    assert not node.arm.delayed.due(1e9)
    learned = play(node, samples, now + 0.02)
    before = len(node.arm.epoch)
    # The clock is set back: the last five messages are rejected at first.
    play(node, samples.select(np.arange(6)), 1.0)
    assert learned and len(node.arm.epoch) == before
    waiting = node.arm.delayed.due(1e9)
    assert [sample.reading.t for sample in waiting] == [pytest.approx(1.09)]
    delayed = DelayedSamples()
    zero = np.zeros(7)
    reading = CompleteReading(0.0, zero, zero, zero)
    delayed.add(reading, zero, True)
    assert not delayed.due(0.1)
    sample, = delayed.due(0.2)
    # A single message has no slope.
    assert sample.qdd is None and not delayed.due(0.3)


def test_inertia_of_the_model_is_no_residual(live, tmp_path):
    samples = recorded(64, 30.0)
    slow = slow_samples(samples).samples
    model = fit(slow).model
    save_model(tmp_path / 'model.json', model)
    node = live(auto_fit=False, settle_time=0.0, model_file=str(tmp_path / 'model.json'))
    # Uneven motion of the second joint alone.
    t = np.arange(0.0, 20.0, 0.02)
    q = np.tile(slow.q[0], (len(t), 1))
    q[:, 1] += 0.1 * np.sin(1.4 * t)
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    qd[:, 1], qdd[:, 1] = 0.14 * np.cos(1.4 * t), -0.196 * np.sin(1.4 * t)
    tau = inverse_dynamics(ARM, q, qd, qdd)
    play(node, JointSamples.single_run(ARM.joints, t, q, qd, tau))
    residual = node.arm.take_residual()
    assert residual[0, 1] > 2.0 * residual[1, 1]
    assert residual[1, 1] < 3.0 * model.noise_with_nuisance[1]


def test_accelerations_are_used_if_most_are_resolved():
    def rows(n_unknown):
        q = np.full(2, 0.1)
        slow = [replace(slow_sample(float(k), q, q, q), qdd=q + k, is_resolved=k >= n_unknown)
                for k in range(20)]
        return rows_of(('a', 'b'), slow).samples.qdd

    qdd = rows(1)[:, 0]
    assert qdd[0] == 0.0
    np.testing.assert_allclose(qdd[1:], 0.1 + np.arange(1, 20))
    assert rows(5) is None


OPTIONS = Parameters(min_samples=15, full_samples=60)


def feed(epoch, n, start=0, step=0.05, still=False):
    for k in range(start, start + n):
        q = np.array([step * k, 0.0 if still else -step * k])
        epoch.offer(slow_sample(0.2 * k, q, np.zeros(2), q, float(k)))


def test_every_fourth_block_is_held_out():
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    feed(epoch, 40)
    rows = rows_of(epoch.names, epoch.samples())
    held_out = [15, 16, 17, 18, 19, 35, 36, 37, 38, 39]
    np.testing.assert_array_equal(np.flatnonzero(rows.held_out), held_out)
    np.testing.assert_allclose(rows.samples.q[:, 0], 0.05 * np.arange(40))
    assert epoch.n_held_out == 10 and len(epoch) == 40 and len(rows.train) == 30
    # Each sample keeps the torque that was published before it.
    np.testing.assert_array_equal(rows.sent[:, 1, 1], np.arange(40.0))


def test_a_clock_that_starts_again_begins_a_run():
    """Samples of two passes over the same stamps, as of a recording that is played twice."""
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    feed(epoch, 30)
    for k in range(30):
        epoch.offer(slow_sample(0.2 * k + 0.05, np.array([0.3, 0.02 * k]), np.ones(2), np.ones(2),
                                float(k)))
    rows = rows_of(epoch.names, epoch.samples())
    assert len(rows) == 60 and rows.samples.n_runs == 2
    np.testing.assert_allclose(rows.samples.t[:30], 0.2 * np.arange(30))
    np.testing.assert_array_equal(rows.sent[:, 0, 0], np.tile(np.arange(30.0), 2))


def test_it_reports_what_is_missing_for_a_fit(model_file):
    epoch = Epoch(3, ['a', 'b'], OPTIONS)
    assert 'no slow samples' in epoch.missing_for_fit()
    feed(epoch, 10)
    assert '10 training and 0 held-out samples' in epoch.missing_for_fit()
    still = Epoch(3, ['a', 'b'], OPTIONS, load_model(model_file))
    feed(still, 20, step=0.002)
    assert 'no joint has moved' in still.missing_for_fit()
    assert still.describe() == ('epoch 3 open, 20 of 60 samples (5 held out), too little range '
                                'on a, b')


def test_the_range_is_that_of_all_samples_of_the_epoch():
    """Also of those that newer ones have replaced; it costs no pass over the buffer."""
    epoch = Epoch(0, ['a', 'b'], OPTIONS)
    np.testing.assert_array_equal(epoch.span(), [0.0, 0.0])
    feed(epoch, 40, still=True)
    epoch._samples = None
    np.testing.assert_allclose(epoch.span(), [0.05 * 39, 0.0])
    epoch.restart()
    np.testing.assert_array_equal(epoch.span(), [0.0, 0.0])


def test_after_broken_effort_it_requires_more_samples(model_file):
    # With 30 of 130 samples held out.
    for broken, needed in ((False, 20), (True, 130)):
        epoch = Epoch(0, ['a', 'b'], OPTIONS, load_model(model_file))
        epoch.restart(broken)
        feed(epoch, 10)
        assert ('after broken effort' in epoch.missing_for_fit()) == broken
        epoch.restart(broken)
        assert due_fits(epoch, 150, True)[0] == needed


def due_fits(epoch, n, succeed, still=False):
    """Offer n samples, and end each fit that is due; return the numbers of samples of the fits."""
    due = []
    for k in range(n):
        feed(epoch, 1, k, still=still)
        if epoch.fit_is_due():
            due.append(k + 1)
            epoch.fit_started()
            assert not epoch.fit_is_due()
            if succeed:
                epoch.fit_succeeded()
    return due


def test_fits_are_due_as_samples_grow_and_the_last_closes_the_epoch(model_file):
    base = load_model(model_file)
    epoch = Epoch(0, ['a', 'b'], OPTIONS, base)
    assert due_fits(epoch, 90, True) == [20, 25, 32, 40, 50, 60]
    # A closed epoch collects samples for fits on request.
    assert not epoch.is_open and len(epoch) == 90 and epoch.missing_for_fit() is None
    # A joint without range keeps it open.
    epoch = Epoch(0, ['a', 'b'], OPTIONS, base)
    due_fits(epoch, 90, True, still=True)
    assert epoch.is_open and epoch.short_of_range() == ('b',)


def test_a_failed_fit_does_not_close_the_epoch_and_is_repeated_with_more_samples(model_file):
    """An effect that the motion does not excite fails each time."""
    epoch = Epoch(0, ['a', 'b'], OPTIONS, load_model(model_file))
    due = due_fits(epoch, 2 * NODE.capacity, False)
    assert epoch.is_open and due[:8] == [20, 25, 32, 40, 50, 60, 75, 94]
    # Also with a full buffer, whose number of samples does not grow.
    assert due[-1] > NODE.capacity and NODE.capacity // 2 <= len(epoch) <= NODE.capacity
