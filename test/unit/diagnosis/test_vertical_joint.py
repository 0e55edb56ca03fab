"""A joint with a vertical axis: its static torque is an effect, not a tilt of its axis."""

from bench.shared.campaign import campaign
from bench.shared.serial_arms import serial_arm
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import FOUND
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

NOISE = 0.02


@pytest.mark.parametrize('seed', [0, *campaign(1, 2)])
@pytest.mark.parametrize('effect, torque', [
    ('torque_offset', lambda q: 0.4 + 0.0 * q), ('joint_spring', lambda q: 0.8 * (q - 0.3))])
def test_an_effect_on_it_is_named(seed, effect, torque):
    arm, rng = serial_arm(4, seed), np.random.default_rng(seed)
    motion = motions.multisine(np.full(4, -0.6), np.full(4, 0.6), np.full(4, 1.0), seed,
                               motions.MultisineOptions(0.15, 60.0), 60.0, 20.0)
    tau = gravity_torque(arm, motion.q) + NOISE * rng.normal(size=motion.q.shape)
    tau[:, 0] += torque(motion.q[:, 0])
    samples = JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)
    named = {(f.effect, f.joint) for f in diagnose(samples).findings if f.verdict in FOUND}
    assert named == {(effect, arm.joints[0])}
