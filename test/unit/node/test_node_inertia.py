"""Inertia in the node: samples wait for later messages, which determine their acceleration."""

from bench.shared.node_messages import play
from gravity_comp_ros.data.differentiation import with_accelerations
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.node.epoch import DelayedSamples, MEAN_OVER, REST_SPEED
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.node_core import NodeCore
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


@pytest.fixture
def live():
    nodes = []

    def make(**settings):
        given = {'unlimited_torque': True, 'settle_time': 0.0, 'max_age': 0.0, **settings}
        nodes.append(NodeCore(Parameters(**given), '/joint_states', 0.0))
        return nodes[-1]

    yield make
    for each in nodes:
        each.close()


def test_samples_of_the_node_are_means_of_the_recording(live):
    node, samples = live(auto_fit=False), recorded(60, 20.0)
    play(node, samples)
    learned, whole = node.arm.epoch.rows().samples, with_accelerations(samples, samples)
    # The last sample has no messages after it.
    assert len(learned) == len(slow_samples(samples).samples) - 1
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
    node = live(auto_fit=False)
    play(node, recorded(60, 20.0, 10.0))
    assert len(node.arm.epoch) > 80 and node.arm.epoch.rows().samples.qdd is None


def test_a_clock_that_starts_again_and_a_new_payload_drop_waiting_samples(live):
    node, samples = live(auto_fit=False), recorded(60, 3.0)
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
    delayed.add(reading)
    delayed.hold(reading, np.zeros((1, 7)))
    assert not delayed.due(0.1)
    sample, = delayed.due(0.2)
    # A single message has no slope.
    assert sample.qdd is None and not delayed.due(0.3)


def test_inertia_of_the_model_is_no_residual(live, tmp_path):
    samples = recorded(64, 30.0)
    slow = slow_samples(samples).samples
    model = fit(slow).model
    save_model(tmp_path / 'model.json', model)
    node = live(auto_fit=False, model_file=str(tmp_path / 'model.json'))
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
