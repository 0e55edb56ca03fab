"""No false facts: the sample recordings, and simulated arms with the effects of the package."""

from pathlib import Path

from bench.shared.campaign import campaign
from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.facts.fact import Kind
from gravity_comp_ros.facts.judge import judge
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.motions import MultisineOptions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

BAGS = sorted((Path(__file__).resolve().parents[3] / 'bags').glob('*.mcap'))
ARM = arms.iiwa7()
FRICTION = np.array([4.0, 4.0, 3.0, 3.0, 1.0, 1.0, 0.5])


@pytest.mark.parametrize('path', BAGS, ids=lambda path: path.stem)
def test_sample_recordings(path):
    # Poses without noise: two joints carry no torque, and there is no velocity.
    expected = {Kind.DEAD_EFFORT, Kind.VELOCITY} if path.stem in (
        'eq15_test', 'random_poses') else set()
    recording = read_bag(path)
    assert {fact.kind for fact in recording.report.facts} == expected
    assert not recording.report.dropped


def facts(samples, tau, qd=None):
    none = np.zeros(samples.n_joints, dtype=bool)
    signals = Signals(samples.names, samples.t, samples.q, samples.qd if qd is None else qd, tau,
                      np.arange(len(samples)), none)
    return {fact.kind for fact in judge(signals, np.ones(samples.n_joints), none).facts
            if fact.kind not in (Kind.DEAD_EFFORT, Kind.CONSTANT_EFFORT)}


def hysteresis(samples):
    """Return friction that builds up over 0.01 rad, by joint (M, N)."""
    out = np.zeros_like(samples.q)
    step = np.diff(samples.q, axis=0)
    for k in range(1, len(out)):
        out[k] = np.clip(out[k - 1] + step[k - 1] / 0.01, -1, 1)
    return FRICTION * out


@pytest.mark.parametrize('speed, noise, seed', [
    (0.1, 0.2, 0), (0.6, 0.0, 1), *campaign((0.1, 0.0, 0), (0.6, 0.2, 0), (0.6, 0.2, 1))])
def test_simulated_motion(speed, noise, seed):
    motion = motions.multisine(ARM.lower, ARM.upper, ARM.max_speed, seed,
                               MultisineOptions(max_speed=speed), rate=20.0)
    samples = synthesise(ARM, motion, SynthesisOptions(noise=NoiseOptions(absolute=noise)))
    rng = np.random.default_rng(seed)
    coulomb = FRICTION * np.tanh(samples.qd / 0.003)
    coarse = np.round((samples.tau + coulomb) / 0.8) * 0.8
    contact = samples.tau + coulomb
    contact[300:340] += 15.0 * np.sin(np.linspace(0, np.pi, 40))[:, None]
    ripple = samples.tau + coulomb + 0.5 * np.sin(40 * samples.q)
    drift = samples.tau + coulomb * np.exp(-samples.t / 40)[:, None]
    for tau in (samples.tau, samples.tau + coulomb, samples.tau + hysteresis(samples), coarse,
                contact, ripple, drift, samples.tau + 3.0 + 0.02 * samples.t[:, None]):
        assert facts(samples, tau) == set()
    late = np.roll(samples.qd, 2, axis=0) + 0.01 * rng.standard_normal(samples.qd.shape)
    assert facts(samples, samples.tau + coulomb, late) == set()
    assert facts(samples, samples.tau + coulomb, differentiate(samples.t, samples.q)) == set()
