"""The chain on a realistic arm: inertia, Coulomb friction on every joint, large noise."""

from bench.shared.campaign import campaign
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.simulation import arms, motions
import numpy as np
import pytest

NOISE = FRICTION = 0.3


@pytest.mark.parametrize('seed', [0, *campaign(1)])
def test_gravity_is_accurate_with_friction_fitted_as_an_effect(seed):
    arm, motion = arms.iiwa7(), motions.eq17()
    tau = arms.inverse_dynamics(arm, motion.q, motion.qd, motion.qdd)
    tau += FRICTION * np.tanh(motion.qd / 0.002)
    tau += NOISE * np.random.default_rng([seed, 7]).normal(size=tau.shape)
    samples = JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)
    friction = [f'coulomb_friction:{name}' for name in samples.names]
    model = fit(samples, FitOptions('chain'), effects=friction).model
    values = [next(iter(e.coefficients.values())).value for e in model.applied.effects]
    assert len(values) == 7 and values == pytest.approx([FRICTION] * 7, abs=0.08)
    wide = np.random.default_rng(1).uniform(arm.lower, arm.upper, (500, 7))
    for q, bound in ((motions.eq17(start=100.0).q, 0.15), (wide, 0.6)):
        error = model.predict(q) - arms.gravity_torque(arm, q)
        assert np.sqrt((error ** 2).mean(axis=0)).max() <= bound
        inside = np.abs(error) <= 1.96 * np.hypot(model.predict_std(q), NOISE)
        assert inside.mean() >= 0.95
