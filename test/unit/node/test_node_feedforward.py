"""Published torque: no steps, within limits, watchdog for input that stops."""

from dataclasses import replace
import math

from gravity_comp_ros.models.gravity_model import Coverage
from gravity_comp_ros.node import feedforward as ff
from gravity_comp_ros.node.feedforward import FeedForward
from gravity_comp_ros.node.messages import nearest_revolution
from gravity_comp_ros.node.parameters import Parameters
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

Q = np.zeros(1)
FREE = Parameters(ramp_time=1.0, max_torque_rate=(), extrapolation_margin=10.0,
                  stale_after=0.3, hold_time=0.5, fade_time=2.0)


def use(feed, predict, reach=math.inf, high=1.0):
    """Use a torque with a trained range from -1 rad."""
    feed.use(predict, Coverage(np.array([-1.0]), np.array([high]), 1), reach)


def constant(torque):
    return lambda q: np.full(1, float(torque))


def linear(slope=10.0):
    return lambda q: slope * q


def played(feed, start, n, q=Q, step=0.1):
    """Return the torques for n messages, None for none."""
    torques = [feed.update(start + step * k, q) for k in range(n)]
    return [None if tau is None else float(tau[0]) for tau in torques]


def started(options=FREE, torque=10.0):
    feed = FeedForward(1, options)
    use(feed, constant(torque))
    played(feed, 0.0, 26)
    return feed, 2.5


def test_it_ramps_from_zero_to_the_first_model():
    feed = FeedForward(1, FREE)
    assert feed.update(0.0, Q) is None and feed.watch(9.0) is None
    assert feed.state(9.0) == ff.NO_MODEL
    use(feed, constant(10.0))
    feed.restart()
    assert feed.watch(9.1) is None and feed.state(9.1) == ff.WAITING
    np.testing.assert_allclose(played(feed, 9.1, 13), [*np.arange(11), 10, 10], atol=1e-9)
    assert feed.state(10.3) == ff.ACTIVE


@pytest.mark.parametrize('enabled', [True, False])
def test_after_a_pause_of_the_life_cycle_torque_goes_on_from_that_published_last(enabled):
    """The controller has kept it: a first torque of zero would drop the arm."""
    feed, t = started()
    feed.restart()
    use(feed, constant(20.0))
    feed.enabled = enabled
    assert feed.watch(t + 60.0) is None
    expected = np.arange(10, 21) if enabled else np.arange(10, -1, -1)
    np.testing.assert_allclose(played(feed, t + 60.0, 11), expected, atol=1e-9)


def test_a_change_is_a_ramp_also_within_another_ramp():
    feed, t = started()
    for target, n in ((20.0, 5), (0.0, 10)):
        before = played(feed, t, 1)[0]
        use(feed, constant(target))
        np.testing.assert_allclose(
            played(feed, t + 0.1, n), before + (target - before) * 0.1 * np.arange(1, n + 1),
            atol=1e-6)
        t += 0.1 * n


@pytest.mark.parametrize('limit', [3.0, 176.0])
@pytest.mark.parametrize('share', [0.1, 0.5, -0.9])
def test_a_swap_is_as_slow_as_the_torque_limit_of_the_arm_requires(limit, share):
    """Within `ramp_time` the torque changes by a fifth of the limit at most, for any arm."""
    start = -0.5 * limit if share > 0.0 else 0.5 * limit
    feed = FeedForward(1, Parameters(max_torque_rate=(), max_torque=(limit,)))
    use(feed, constant(start))
    t = 0.0
    for _ in range(1500):
        t += 0.004
        feed.update(t, Q)
    use(feed, constant(start + share * limit))
    torques = [start]
    while abs(torques[-1] - start - share * limit) > 1e-6:
        # Every hundredth message is late by three periods.
        t += 0.016 if len(torques) % 100 == 0 else 0.004
        torques.append(float(feed.update(t, Q)[0]))
        assert len(torques) < 2500
    # A late message counts as two periods.
    slope = min(abs(share), 0.2) * limit
    assert np.abs(np.diff(torques)).max() <= 0.008 * slope * 1.001
    assert 0.004 * len(torques) == pytest.approx(max(1.0, abs(share) / 0.2), rel=0.1)


def test_a_swap_within_a_swap_follows_the_pose():
    """The offset of the first swap decays; each swap adds at most the motion of one message."""
    feed = FeedForward(1, FREE)
    use(feed, linear())
    q = np.zeros(1)
    for k in range(26):
        feed.update(0.1 * k, q)
    for swap, slope in enumerate((11.0, 12.0)):
        use(feed, linear(slope))
        for k in range(4):
            q = q + 0.1
            tau = float(feed.update(2.6 + 0.1 * (4 * swap + k), q)[0])
            assert 10.0 * (q[0] - 0.1 * (swap + 1)) - 1e-6 <= tau <= slope * q[0] + 1e-6


def test_a_torque_in_transition_never_moves_away_from_its_target():
    """The arm passes the vertical during the first ramp; the torque does not overshoot."""
    feed, last = FeedForward(1, FREE), 0.0
    use(feed, linear())
    for k in range(20):
        target = 10.0 * (1.0 - 0.2 * k)
        tau = played(feed, 0.05 * k, 1, np.array([0.1 * target]))[0]
        assert min(last, target) - 1e-9 <= tau <= max(last, target) + 1e-9
        last = tau
    assert last == pytest.approx(-28.0)


def test_disabled_torque_ramps_to_zero_and_then_nothing_is_published():
    feed, t = started()
    feed.enabled = False
    np.testing.assert_allclose(played(feed, t + 0.1, 10), 10.0 - np.arange(1, 11), atol=1e-9)
    assert played(feed, t + 1.1, 1) == [None] and feed.state(t + 1.1) == ff.DISABLED
    feed.enabled = True
    assert played(feed, t + 1.2, 1) == pytest.approx([1.0])


@pytest.mark.parametrize('enabled', [True, False])
def test_after_an_error_the_torque_falls_to_zero(enabled):
    """By a clock of another origin; also while disabled torque ramps down."""
    feed, t = started(replace(FREE, stale_action='hold'))
    feed.enabled = enabled
    last = played(feed, t + 0.1, 1)[0]
    feed.fail()
    torques = [feed.watch(-1000.0 + 0.1 * k) for k in range(22)]
    falling = [last, *(float(tau[0]) for tau in torques if tau is not None)]
    assert falling[-1] == 0.0 and (np.diff(falling) <= 0.0).all() and torques[-1] is None


def test_stale_input_holds_then_fades_to_zero_then_publishes_nothing():
    feed, t = started()
    assert feed.watch(t + 0.3) is None
    assert float(feed.watch(t + 0.31)[0]) == 10.0 and feed.state(t + 0.31) == ff.HOLDING
    assert float(feed.watch(t + 0.8)[0]) == 10.0
    torques = [float(feed.watch(t + 0.8 + 0.1 * k)[0]) for k in range(1, 21)]
    np.testing.assert_allclose(torques, 10 - 0.5 * np.arange(1, 21), atol=1e-9)
    assert feed.state(t + 2.81) == ff.FADED
    assert feed.watch(t + 3.0) is None
    feed, t = started(replace(FREE, stale_action='hold'))
    assert float(feed.watch(t + 1e6)[0]) == 10.0


def test_torque_and_its_rate_are_limited():
    options = replace(FREE, ramp_time=0.0, max_torque=(5.0,), max_torque_rate=(20.0,))
    feed = FeedForward(1, options)
    use(feed, linear())
    torques = [float(feed.update(0.1 * k, np.array([1.0 if k < 8 else -1.0]))[0])
               for k in range(14)]
    assert torques == pytest.approx([0, 2, 4, 5, 5, 5, 5, 5, 3, 1, -1, -3, -5, -5])


def test_a_lowered_limit_applies_at_once():
    feed, t = started(replace(FREE, max_torque_rate=(1.0,)), torque=1.0)
    feed.set_options(replace(FREE, max_torque=(0.1,), max_torque_rate=(1.0,)))
    assert float(feed.update(t + 0.001, Q)[0]) == pytest.approx(0.1)


@pytest.mark.parametrize('before, after', [
    ({'max_torque': (2.0,)}, {'max_torque': (20.0,)}), ({'max_torque': (2.0,)}, {}),
    ({'extrapolation_margin': 0.5}, {'extrapolation_margin': 1.0})])
def test_a_parameter_that_changes_the_torque_causes_a_ramp(before, after):
    feed, q = FeedForward(1, replace(FREE, ramp_time=0.0, **before)), np.array([2.0])
    use(feed, linear())
    torques = [played(feed, 0.0, 2, q)[1]]
    feed.set_options(replace(FREE, **{**before, **after} if after else {}))
    torques += played(feed, 0.2, 60, q)
    assert torques[-1] >= torques[0] + 4.9 and np.diff(torques).max() <= 0.1 * 20.0


@pytest.mark.parametrize('reach, expected', [
    (math.inf, [10, 15, 15, 15]), (0.1, [10, 11, 11, 11])])
def test_beyond_a_margin_outside_the_trained_range_torque_is_that_of_the_nearest_pose(
        reach, expected):
    """The reach of a model bounds the margin."""
    feed = FeedForward(1, replace(FREE, ramp_time=0.0, extrapolation_margin=0.5))
    use(feed, lambda q: 10.0 * q, reach=reach)
    assert feed.margin == min(0.5, reach)
    torques = [played(feed, 0.1 * k, 1, np.array([q]))[0]
               for k, q in enumerate((0.0, 1.0, 1.5, 2.0, 2.5))]
    assert torques[1:] == pytest.approx(expected)


def test_a_torque_that_is_not_finite_counts_as_missing_input():
    feed, t = started()
    use(feed, lambda q: np.array([np.nan]))
    assert feed.update(t + 0.1, Q) is None
    assert float(feed.watch(t + 0.5)[0]) == 10.0
    use(feed, constant(11.0))
    for k in range(6, 20):
        tau = feed.update(t + 0.1 * k, Q)
    assert float(tau[0]) == pytest.approx(11.0)


def test_a_clock_jump_causes_no_torque_step():
    feed = FeedForward(1, replace(FREE, max_torque_rate=(10.0,)))
    use(feed, constant(100.0))
    feed.update(0.0, Q)
    first = float(feed.update(1e9, Q)[0])
    assert first <= 10.0 * FREE.stale_after + 1e-9
    assert float(feed.update(-1e9, Q)[0]) == first


steps = st.lists(st.tuples(
    st.sampled_from(['update', 'watch', 'enable', 'disable', 'swap', 'silence']),
    st.floats(-0.05, 0.4), st.floats(-5, 5)), max_size=60)


@settings(max_examples=150)
@given(steps)
def test_no_sequence_of_events_exceeds_the_limits(script):
    options = Parameters(ramp_time=0.5, max_torque=(8.0,), max_torque_rate=(50.0,),
                         extrapolation_margin=0.5)
    feed, now, last, budget, seen = FeedForward(1, options), 0.0, 0.0, 0.0, 0.0
    use(feed, linear())
    for what, dt, x in script:
        now += dt * (10 if what == 'silence' else 1)
        budget, seen = budget + max(0.0, now - seen), now
        tau = None
        if what == 'update':
            tau = feed.update(now, np.array([x]))
        elif what == 'watch':
            tau = feed.watch(now)
        elif what in ('enable', 'disable'):
            feed.enabled = what == 'enable'
        elif what == 'swap':
            use(feed, constant(20 * x))
        if tau is not None:
            assert abs(float(tau[0])) <= 8.0
            # The time of a stall is spread over the messages that follow.
            assert abs(float(tau[0]) - last) <= 50.0 * budget + 1e-9
            budget -= abs(float(tau[0]) - last) / 50.0
            last = float(tau[0])


def test_the_watchdog_works_after_the_clock_was_set_back():
    feed, t = started()
    assert feed.watch(t - 1000.0) is None
    assert feed.watch(t - 999.0) is not None and feed.state(t - 999.0) in (ff.HOLDING, ff.FADING)


@pytest.mark.parametrize('pause', [0.25, 0.35, 5.0, 100.0])
def test_returning_torque_ramps_from_its_present_value(pause):
    """After a pause and a fade the step of the first message is that of one period."""
    feed = FeedForward(1, replace(FREE, ramp_time=1.0, fade_time=0.1, hold_time=0.0,
                                  max_torque_rate=(1000.0,)))
    use(feed, constant(10.0))
    for k in range(1, 1500):
        feed.update(0.001 * k, Q)
    t, last = 1.5, 10.0
    for k in range(int(pause / 0.02)):
        tau = feed.watch(t + 0.02 * k)
        last = last if tau is None else float(tau[0])
    first = float(feed.update(t + pause, Q)[0])
    assert (last == 0.0) == (pause > 1.0) and abs(first - last) <= 0.05
    t += pause
    steps = np.diff([first, *(float(feed.update(t + 0.001 * k, Q)[0]) for k in range(1, 1100))])
    assert np.abs(steps).max() <= 0.02 + 1e-9


@pytest.mark.parametrize('stall', [0.05, 0.25, 0.29])
def test_a_stall_of_a_moving_arm_causes_no_torque_step(stall):
    feed = FeedForward(1, replace(FREE, ramp_time=0.0, max_torque_rate=(500.0,)))
    use(feed, linear())
    for k in range(500):
        last = feed.update(0.004 * k, np.zeros(1))
    torques = [float(last[0]), *(float(feed.update(2.0 + stall + 0.004 * k, np.full(1, 3.0))[0])
                                 for k in range(100))]
    assert np.abs(np.diff(torques)).max() <= 2 * 500.0 * 0.004 + 1e-9
    assert torques[-1] == pytest.approx(30.0)


def test_a_burst_after_a_pause_delays_the_torque_only_briefly():
    feed = FeedForward(1, replace(FREE, ramp_time=0.0, max_torque_rate=(500.0,)))
    use(feed, linear())
    for k in range(100):
        feed.update(0.1 * k, np.zeros(1))
    for k in range(5):
        feed.update(10.2 + 1e-4 * k, np.zeros(1))
    assert float(feed.update(10.3, np.full(1, 3.0))[0]) == pytest.approx(30.0)


def turned(feed, start, poses, step=0.01):
    """Return the torques for poses of the driver, which the reader of the messages counts."""
    torques, last = [], np.array([np.nan])
    for k, q in enumerate(poses):
        last = nearest_revolution(feed._coverage, np.array([q]), last)
        torques.append(float(feed.update(start + step * k, last)[0]))
    return np.array(torques)


@settings(max_examples=50)
@given(st.floats(-3, 3), st.integers(-5, 5), st.sampled_from([0.5, 10.0]))
def test_torque_has_a_period_of_one_revolution(q, revolutions, margin):
    feed = FeedForward(1, replace(FREE, ramp_time=0.0, extrapolation_margin=margin))
    use(feed, lambda q: 10.0 * np.sin(q), high=2.0)
    # A driver may count revolutions in another way after a start, or wrap the angle.
    here, there = turned(feed, 0.0, (q, q + 2 * np.pi * revolutions))
    if -1.0 <= q <= 2.0:
        assert there == pytest.approx(10.0 * np.sin(q), abs=1e-9)
    assert there == pytest.approx(here, abs=1e-9)


@pytest.mark.parametrize('path', ['turn', 'stand', 'wrap'])
def test_torque_does_not_step_half_a_revolution_from_the_trained_range(path):
    """There the nearest pose of the range is another one, and so is the torque that is held."""
    feed, rng = FeedForward(1, Parameters(max_torque=(100.0,))), np.random.default_rng(0)
    feed.use(lambda q: 50.0 * np.sin(q), Coverage(-0.4 * Q - 0.4, Q + 0.4, 1))
    turn = np.linspace(0.0, 2.0 * np.pi, 629)
    if path != 'turn':
        turn = np.concatenate((turn[turn < 3.14], np.pi + 1e-3 * rng.standard_normal(500)))
    if path == 'wrap':
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
    torques = turned(feed, 0.0, turn)
    # A fifth of the limit within `ramp_time`, and the motion of 1 rad/s within the range.
    assert np.abs(np.diff(torques)).max() <= 0.01 * (20.0 + 50.0) + 1e-6
    if path != 'turn':
        assert torques[-300:].std() < 1e-9
    else:
        assert turned(feed, 6.28, np.zeros(500))[-1] == pytest.approx(0.0)


def test_a_joint_whose_range_exceeds_a_revolution_has_its_own_revolution_within_it():
    feed = FeedForward(1, replace(FREE, ramp_time=0.0))
    use(feed, lambda q: 10.0 * q, high=6.0)
    turns = np.array([0, 0, 1, 1, 0, 0])
    poses = np.array([5.9, 6.1, 6.3, 6.1, 5.9, -0.9])
    assert turned(feed, 0.0, poses) == pytest.approx(10.0 * (poses - 2 * np.pi * turns))
