"""Payload picked up during a recording: predictions include it afterwards."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7, Payload, with_payload
from gravity_comp_ros.simulation.motions import eq17
import numpy as np

NOISE = 0.1


def recorded(seconds, first, start, time, seed):
    """Return Eq. (17) from `first` s on; 2 kg are picked up after `time` s."""
    arm, motion = iiwa7(), eq17(seconds, 2.5, first)
    after = (motion.t >= time)[:, None]
    tau = np.where(after, gravity_torque(with_payload(arm, Payload(2.0)), motion.q),
                   gravity_torque(arm, motion.q))
    tau += NOISE * np.random.default_rng(seed).standard_normal(tau.shape)
    return JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau, start=start)


def test_gravity_includes_the_last_payload():
    samples = recorded(120.0, 0.0, 1.7e9, 60.0, 1)
    before = fit(samples).model
    result = refit(samples, before, requests(['payload_change'], before.joints))
    assert not result.implausible
    later = recorded(100.0, 300.0, 1.7e9 + 1000.0, 0.0, 2)
    for residual in (samples.tau - predict_torque(result.model, samples),
                     later.tau - predict_torque(result.model, later),
                     later.tau - result.model.predict(later.q)):
        assert np.sqrt((residual ** 2).mean(axis=0)).max() < 1.5 * NOISE
