"""Synthesised samples: noise level, time of the payload, order of disturbances and noise."""

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.synthesise import (
    NoiseOptions, Signals, synthesise, SynthesisOptions)
import numpy as np
import pytest

ARM = arms.iiwa7()


def test_noise_is_seeded_and_has_the_given_level():
    motion = motions.random_poses(ARM.lower, ARM.upper, 3000, seed=1)
    clean = synthesise(ARM, motion)
    noise = NoiseOptions(relative=0.01)
    one, same, other = (synthesise(ARM, motion, SynthesisOptions(noise=noise, seed=seed))
                        for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.tau, same.tau)
    assert np.abs(one.tau - other.tau).max() > 0.1
    ratio = (one.tau - clean.tau)[:, 1] / clean.tau[:, 1]
    assert ratio.std() == pytest.approx(0.01, rel=0.05)
    absolute = synthesise(ARM, motion, SynthesisOptions(noise=NoiseOptions(absolute=0.1)))
    np.testing.assert_allclose((absolute.tau - clean.tau).std(axis=0), 0.1, rtol=0.06)


class Offset:
    """A sensor offset that also uses its own random stream."""

    def __init__(self, size):
        self.size = size

    def apply(self, signals, motion, arm, rng):
        rng.standard_normal(10)
        return Signals(signals.q, signals.qd, signals.tau + self.size)


class Gain:
    """A gain error, to test the order with Offset."""

    def apply(self, signals, motion, arm, rng):
        return Signals(signals.q, signals.qd, 2 * signals.tau)


def test_disturbances_act_in_order_and_do_not_change_the_noise():
    motion = motions.eq17(duration=5)
    noise = NoiseOptions(absolute=0.1)
    clean = synthesise(ARM, motion)
    plain = synthesise(ARM, motion, SynthesisOptions(noise=noise))
    both = synthesise(ARM, motion, SynthesisOptions(
        noise=noise, disturbances=(Offset(3.0), Gain())))
    added = plain.tau - clean.tau
    np.testing.assert_allclose(both.tau, 2 * (clean.tau + 3.0) + added, atol=1e-12)


@pytest.mark.parametrize('options', [
    {'relative': -1.0}, {'absolute': float('nan')}, {'absolute': float('inf')}])
def test_invalid_noise(options):
    with pytest.raises(OptionError, match=next(iter(options))):
        NoiseOptions(**options)
