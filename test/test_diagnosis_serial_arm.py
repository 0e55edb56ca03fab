"""Diagnosis of a serial arm whose recordings hardly separate effects from gravity."""

from dataclasses import replace

from bench.cases.generated import generated_arm
from bench.planning.scenes import Scene, wide_motion
from fast_arms import recording
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.base import choose_base
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Verdict
from gravity_comp_ros.diagnosis.nuisance import nuisance_torque
from gravity_comp_ros.effects.arm_dynamics import chain_dynamics
from gravity_comp_ros.effects.motion import build_motion
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

NO_GRAVITY = GravityModel.from_energy(
    ('a',), 'potential', Expansion(np.zeros(0, dtype=np.int64), np.zeros(0)), np.zeros(1),
    Coverage(np.zeros(1), np.zeros(1), 1, 1), {})


def poor_model(scene):
    return fit(slow_samples(scene.recorded()).samples, FitOptions('chain')).model


def with_wide_motion(scene):
    """Return a poor recording, followed by 20 s of slow motion in half of the joints' range."""
    new = scene.later(wide_motion(scene.arm_model, scene.seed))
    return concatenate([scene.recorded(), new])


def of_joint(scene, samples):
    name = scene.arm_model.joints[scene.joint]
    diagnosis = diagnose(samples, poor_model(scene))
    return {f.effect: f for f in diagnosis.findings if f.joint == name}


def test_gravity_has_the_derivatives_of_the_chain_only():
    scene = Scene('right_seven', 'torque_offset', 3, 'one_posture', 21)
    base = choose_base(with_wide_motion(scene), poor_model(scene), 2000)
    q, n = base.motion.samples.q, scene.arm_model.n_joints
    assert base.chain is not None and base.columns.shape[2] < 4 * n
    error = base.motion.gravity - gravity_torque(scene.arm_model, q)
    assert np.sqrt((error ** 2).mean(axis=0)).max() < 0.5


def test_dynamics_of_a_model_have_its_own_arm_if_no_arm_fits_the_torque():
    """A spring on a joint was an internal error if the model had rigid-body dynamics."""
    samples = recording(generated_arm(0), 0, 20.0, 50.0)
    chain = choose_base(samples, None, 1000).chain
    model = GravityModel.from_energy(samples.names, 'chain', expand(chain), np.ones(6),
                                     Coverage.of(samples), {}, chain)
    n_columns = len(chain_dynamics(chain).coefficients())
    dynamics = AppliedEffect('rigid_body_dynamics', None, {},
                             {'s': Value(1.0, '', (1.0, 1.0))})
    shape = np.full(model.n_joints, 0.1)
    with_dynamics = replace(model, applied=Applied((dynamics,), {'width': shape}))
    tau = samples.tau.copy()
    tau[:, 2] += 30.0 * np.sin(samples.q[:, 2] - 1.0)
    with_spring = replace(samples, tau=tau)
    without = choose_base(with_spring, model, 1000)
    assert without.motion.serial_arm is None
    base = choose_base(with_spring, with_dynamics, 1000)
    assert base.motion.serial_arm is chain
    assert base.columns.shape[2] == without.columns.shape[2] + n_columns
    assert np.isfinite(base.columns).all()


@pytest.mark.parametrize('arm', ['right_seven', 'right_six'])
def test_an_offset_in_narrow_motion_is_established_with_wide_motion(arm):
    scene = Scene(arm, 'torque_offset', 3, 'narrow', 21)
    assert not of_joint(scene, scene.recorded())
    offset = of_joint(scene, with_wide_motion(scene))['torque_offset']
    low, high = offset.coefficients['b'].ci95
    assert offset.verdict == Verdict.ESTABLISHED and low < 1.5 < high


def test_load_friction_at_one_load_is_ambiguous_and_established_at_several():
    """Coulomb friction was established wherever load friction explained slightly more."""
    scene = Scene('right_seven', 'load_dependent_friction', 3, 'settled_narrow', 21)
    friction = of_joint(scene, scene.recorded())['coulomb_friction']
    assert friction.verdict == Verdict.AMBIGUOUS
    assert friction.rivals == ('load_dependent_friction',)
    both = of_joint(scene, with_wide_motion(scene))
    assert both['load_dependent_friction'].verdict == Verdict.ESTABLISHED
    assert 'coulomb_friction' not in both


def test_gravity_has_the_torque_that_an_offset_could_explain():
    """Half of 3 N·m was an offset, since least squares splits a sum of equal columns."""
    t = 0.05 * np.arange(2000)
    q, qd = np.sin(t)[:, None], np.cos(t)[:, None]
    tau = 3.0 + 5.0 * np.sin(2.0 * q) + 0.1 * np.random.default_rng(0).normal(size=q.shape)
    samples = JointSamples.single_run(('a',), t, q, qd, tau)
    motion = build_motion(samples, NO_GRAVITY)
    gravity = np.stack([np.ones_like(q), np.sin(2.0 * q)], axis=2)
    assert np.abs(nuisance_torque(gravity, motion)).max() < 0.1
