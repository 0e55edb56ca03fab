"""Simulated greased gear: torque by hand, and comparison with the library."""

from gravity_comp_ros.simulation.arms import iiwa7
from gravity_comp_ros.simulation.disturbances.friction import GreasedGear, LuGre
from gravity_comp_ros.simulation.motions import sample
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pytest

ARM, JOINT = iiwa7(), 3


def torque(speed, gear):
    """Return the friction at the end of 2 s of motion at a speed in rad/s."""
    def path(t):
        qd = np.zeros((len(t), 7))
        qd[:, JOINT] = speed
        return qd * t[:, None], qd, 0.0 * qd

    motion = sample('steady', path, 2.0, 200.0)
    still = Signals(motion.q, motion.qd, np.zeros_like(motion.q))
    out = gear.apply(still, motion, ARM, np.random.default_rng(0)).tau
    assert not np.delete(out, JOINT, axis=1).any()
    return out[-1, JOINT]


def test_slow_grease_is_viscous_and_fast_grease_grows_with_the_logarithm():
    gear = GreasedGear(JOINT, 2.0, 0.05, LuGre(0.0))
    assert torque(0.001, gear) == pytest.approx(2.0 * 0.001 / 0.05, rel=1e-3)
    assert torque(2.0, gear) - torque(1.0, gear) == pytest.approx(2.0 * np.log(2.0), rel=1e-3)
    assert torque(-0.5, gear) == pytest.approx(-torque(0.5, gear))


def test_coulomb_friction_is_added():
    dry, both = LuGre(1.5), GreasedGear(JOINT, 2.0, 0.05, LuGre(1.5))
    alone = torque(0.3, GreasedGear(JOINT, 2.0, 0.05, LuGre(0.0)))
    assert torque(0.3, both) - alone == pytest.approx(dry.coulomb, rel=1e-3)
