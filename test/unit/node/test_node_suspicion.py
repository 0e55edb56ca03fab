"""Unannounced payloads are suspected; friction, contacts and broken effort are not."""

from dataclasses import replace
import time

from bench.shared.campaign import campaign
from bench.shared.payload_samples import ARM, Core, force_torque, friction, learned, NOISE
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.evaluation.expected_residual import expected_residual, residual_noise
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check, Job, PAYLOAD, PayloadResult
from gravity_comp_ros.node.diagnostics import OK, WARN
from gravity_comp_ros.node.epoch import Rows, rows_of, SlowSample
from gravity_comp_ros.node.jobs import run_payload_test
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.model_in_use import ModelInUse
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.watch import Watch
from gravity_comp_ros.simulation.arms import gravity_torque, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17
from hypothesis import given, strategies as st
import numpy as np
import pytest

N = 50


@pytest.fixture(scope='module')
def model():
    return learned(np.random.default_rng(5))


def window(mass=0.0, rough=1.0, force=None, start=170.0, seed=0, seconds=N / 5.0, gain=1.0):
    """Return the samples of an arm with friction in some seconds of slow motion."""
    motion = eq17(seconds, 5.0, start)
    arm = ARM if mass == 0.0 else with_payload(ARM, Payload(mass, (0.08, -0.05, 0.1)))
    tau = gravity_torque(arm, motion.q)
    tau += rough * friction(motion.qd)
    tau += NOISE * np.random.default_rng(seed).standard_normal(tau.shape)
    if force is not None:
        tau[force[0]] += force[1]
    tau[:, 1] *= gain
    return JointSamples.single_run(ARM.joints, motion.t, motion.q, motion.qd, tau)


def pushed(force, start=170.0, seed=0, varies=0.0, seconds=N / 5.0):
    """Return slow motion with a constant or varying force (3,) on the last link, N."""
    samples = window(start=start, seed=seed, seconds=seconds)
    size = 1.0 + varies * np.sin(2.0 * np.pi * (samples.t - samples.t[0]) / 5.0)
    torque = [part * force_torque(q, np.array(force))
              for part, q in zip(size, samples.q)]
    return replace(samples, tau=samples.tau + np.array(torque))


def finding(model, samples, geometry=None):
    return run_payload_test(
        Job(PAYLOAD, Rows(samples, np.zeros(len(samples), dtype=bool)), model, geometry=geometry))


DOWN = (0.0, 0.0, 20.0)
PUSH, VARYING = 'pushes or pulls the last link, not only downwards', 'a varying force acts'
# Samples, whether the axes are known, whether a payload is found, and the reason if it is another
# force: a constant force downwards is not distinguished from a payload.
CASES = {
    'a payload': (lambda: window(1.0), False, True, ''),
    'a payload on known axes': (lambda: window(3.0), True, True, ''),
    'a force downwards': (lambda: pushed(DOWN, seconds=16.0), False, True, ''),
    'a force downwards on known axes': (lambda: pushed(DOWN, seconds=16.0), True, True, ''),
    'a varying force': (lambda: pushed(DOWN, varies=0.1, seconds=16.0), False, False, VARYING),
    'a varying force on known axes': (lambda: pushed(DOWN, varies=0.1, seconds=16.0), True, False,
                                      VARYING),
    'a push': (lambda: pushed((10.0, 0.0, 0.0)), False, False, PUSH),
    'a push on known axes': (lambda: pushed((0.0, 3.0, 10.0)), True, False, PUSH)}


@pytest.mark.parametrize('name', CASES)
def test_a_payload_is_found_and_another_force_is_reported(name, model, geometry):
    samples, known, is_payload, reason = CASES[name]
    result = finding(model, samples(), geometry if known else None)
    assert result.is_payload == is_payload and result.is_other == bool(reason), result.text
    assert reason in result.text
    if is_payload:
        assert float(result.values['log evidence']) > 20.0
    if name == 'a payload on known axes':
        assert float(result.values['mass [kg]']) == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize('change', [
    {'rough': 0.5}, {'force': (slice(0, 25), np.array([0, 20.0, 0, -9.0, 0, 2.0, 0]))},
    {'gain': -1.0}, *campaign({}, {'rough': 1.6}, {'force': (slice(20, 34), 15.0)})],
    ids=['less friction', 'a longer touch', 'a wrong sign', 'nothing', 'more friction', 'a touch'])
def test_friction_contacts_and_broken_effort_are_no_payload(change, model, geometry):
    for axes in (None, geometry):
        assert not finding(model, window(**change), axes).is_payload


def with_fitted(model, *effects):
    """Return a model with nuisance terms: name, joint number, setting, coefficients."""
    return replace(model, applied=Applied(), fitted=Applied(tuple(
        AppliedEffect(name, ARM.joints[joint], setting,
                      {symbol: Value(x, '', (x, x)) for symbol, x in values.items()})
        for name, joint, setting, values in effects)), residual_std=np.full(7, 0.1))


def test_nuisance_terms_are_subtracted_and_friction_is_kept_at_rest(model):
    fitted = with_fitted(model, ('coulomb_friction', 1, {'distance': 1e-4}, {'F_c': 2.0}),
                         ('viscous_friction', 2, {}, {'F_v': 4.0}),
                         ('torque_offset', 3, {}, {'b': -0.7}),
                         ('load_dependent_friction', 4, {'width': 0.002}, {'mu': 0.1}))
    in_use, gravity = ModelInUse(fitted), np.full(7, -5.0)

    def nuisance(q, qd):
        reading = CompleteReading(0.0, q, qd, np.zeros(7))
        error, residual = in_use.residual(reading, gravity, np.ones(7))
        np.testing.assert_array_equal(error, -gravity)
        return error - residual

    q, qd = np.zeros(7), np.full(7, 0.1)
    nuisance(q, qd)
    moving = nuisance(q + 0.01, qd)
    np.testing.assert_allclose(moving, [0.0, 2.0, 0.4, -0.7, 0.5, 0.0, 0.0], atol=1e-9)
    still = nuisance(q + 0.01, 0.0 * qd)
    np.testing.assert_allclose(still[1:5], [2.0, 0.0, -0.7, 0.0], atol=1e-9)
    assert nuisance(q, -qd)[1] == pytest.approx(-2.0)
    # Friction drifts by 0.3 of its size; an offset does not.
    np.testing.assert_allclose(expected_residual(fitted)[[1, 2, 3]],
                               [np.hypot(0.1, 0.6), np.hypot(0.1, 0.12), 0.1], atol=2e-3)
    assert residual_noise(model).max() < 0.3 * model.noise.max()


def watching(min_duration=16.0):
    """Return the watch of a model of one joint, with a noise of 1 N·m."""
    watch, coverage = Watch(min_duration), Coverage(np.zeros(1), np.ones(1), 100)
    torque = Expansion(np.array([1]), np.array([5.0]))
    watch.use(GravityModel(('a',), 'per_joint', (torque,), None, np.ones(1), coverage), None, 0)
    return watch


def offer(watch, t, q, ratio):
    zero = np.zeros(1)
    reading = CompleteReading(t, np.array([q]), zero, zero)
    watch.offer(SlowSample(reading, zero, zero), zero, np.array([ratio]))


def offered(watch, ratios, start=0.0):
    for k, ratio in enumerate(ratios):
        t = start + 0.2 * k
        offer(watch, t, 0.05 * t, ratio)


def test_a_test_is_due_only_for_a_lasting_residual():
    watch = watching()
    offered(watch, [-9.0] * (NODE.window - 1))
    assert not watch.is_due()
    offered(watch, [-9.0], 100.0)
    assert watch.is_due()
    window = rows_of(('a',), watch.window()).samples
    assert len(window) == NODE.window and window.qdd is not None and not watch.is_due()
    # On the clock of the messages, by which warming and drift are predicted.
    assert window.starts == (0.0,) and window.t[-1] == pytest.approx(100.0)
    short_contact = watching()
    offered(short_contact, [1.0] * NODE.window + [30.0] * (NODE.window // 3) + [1.0] * NODE.window)
    assert not short_contact.is_due()


@given(st.floats(0.0, 60.0), st.floats(3.0, 40.0), st.floats(1.0, 5.0))
def test_only_a_lasting_change_is_a_payload(lasting, lasts, rate):
    """Although each test finds a payload."""
    watch, suspected = watching(lasting), []
    for t in np.arange(0.0, lasts + 10.0, 1.0 / rate):
        ratio = 9.0 if t <= lasts else 1.0
        offer(watch, t, 0.1 * t, ratio)
        if watch.is_due():
            window = rows_of(('a',), watch.window()).samples
            assert NODE.window <= len(window) <= NODE.max_window
            assert window.t[-1] - window.t[0] >= lasting
            if watch.add_finding(PayloadResult(
                    'a payload', (Check(checks.BODY_PRESENT, 1.0, 0.0, True),))):
                suspected.append(t)
    assert len(suspected) <= 1 and all(t >= lasting for t in suspected)
    if lasts < lasting:
        assert not suspected
    # The samples between two tests.
    longest = 1.0 / rate
    if lasts > max(lasting, NODE.window * longest) + 15.0 * longest:
        assert suspected


def core_with(model, **settings):
    """Return the core of a node with a model in use."""
    core = Core(model)
    core.live.set(replace(core.live.settings, **settings))
    return core


def play(core, samples, until):
    """Send samples at 10 Hz until a condition is true."""
    for k in range(len(samples)):
        for j in range(2):
            t = samples.t[k] + 0.1 * j
            q = samples.q[k] + 0.1 * j * samples.qd[k]
            core.send(t, q, samples.qd[k], samples.tau[k])
        core.live.tick(t, time.monotonic())
        while core.live.fits.job is not None:
            time.sleep(0.002)
            core.live.tick(t, time.monotonic())
        if until():
            return


@pytest.mark.parametrize('action', ['report', 'learn'])
def test_the_node_reports_a_payload_or_learns_it(action, model):
    core = core_with(model, on_suspected_payload=action, settle_time=0.0)
    live = core.live
    try:
        play(core, window(seed=1), lambda: live.events.payloads)
        assert not live.events.payloads
        play(core, window(2.0, start=190.0, seconds=22.0), lambda: live.events.payloads)
        event = live.events.payloads.popleft()
        assert 'another payload is suspected' in event.text
        assert float(event.values['from [s]']) > 185.0
        assert any('another payload' in text for _, text in live.events.log)
        status = {each.name: each for each in live.statuses(212.0)}['payload']
        if action == 'learn':
            assert live.arm.epoch.number == 1 and live.arm.epoch.is_open
            assert 'opened automatically' in live.learner.report and status.level == OK
        else:
            assert live.arm.epoch.number == 0 and status.level == WARN
            play(core, window(2.0, start=212.0), lambda: live.events.payloads)
            assert not live.events.payloads, 'suspected once'
            play(core, window(start=222.0), lambda: False)
            status = {each.name: each for each in live.statuses(232.0)}['payload']
            assert status.level == OK
    finally:
        live.close()
