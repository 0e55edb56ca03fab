"""Arms with too many joints for a sparse energy."""

from dataclasses import replace

from bench.cases.generated import generated_arm
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import FOUND
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.applied_effects import Applied
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.simulation.disturbances.friction import Friction, LuGre
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

N = 10


@pytest.fixture(scope='module')
def samples():
    """Return two minutes of slow motion of ten joints, with 2 N·m of friction on the fourth."""
    arm = generated_arm(4, N, right_angles=True)
    friction = (Friction(3, LuGre(2.0)),)
    how = MultisineOptions(max_speed=0.2)
    return concatenate([
        synthesise(arm, multisine(arm.lower, arm.upper, np.full(N, 1.5), seed, how, 60.0, 10.0),
                   SynthesisOptions(NoiseOptions(absolute=0.05), seed, disturbances=friction))
        for seed in range(2)])


@pytest.mark.campaign
def test_friction_on_one_of_ten_joints_is_named(samples):
    findings = diagnose(samples).findings
    named = [(f.effect, f.joint) for f in findings if f.verdict in FOUND]
    assert ('coulomb_friction', 'joint_4') in named, [f.to_json() for f in findings]
    # Laws that nearly cancel share the level; their sum is that of the bristles.
    model = fit(samples).model
    of_joint = tuple(e for e in model.fitted.effects if e.joint == 'joint_4')
    torque = effect_torque(replace(model, applied=Applied(of_joint)), samples)[:, 3]
    sliding = np.abs(samples.qd[:, 3]) > 0.02
    assert np.abs(torque - 2.0 * np.sign(samples.qd[:, 3]))[sliding].mean() < 0.04


def test_the_slope_of_a_chain_with_many_terms_is_that_of_its_terms():
    rng = np.random.default_rng(0)
    axes = np.stack([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(7)])
    axes[np.linalg.det(axes) < 0.0, :, 0] *= -1.0
    chain = Chain(axes, rng.normal(size=(7, 2)))
    names = tuple('abcdefg')
    coverage = Coverage(np.full(7, -3.0), np.full(7, 3.0), 10)
    model = GravityModel.from_energy(names, 'chain', expand(chain), np.ones(7), coverage, {},
                                     chain)
    assert len(model.energy.indices) > 1000
    q = rng.uniform(-3.0, 3.0, (20, 7))
    by_terms = gravity_gradient(replace(model, chain=None), q)
    assert gravity_gradient(model, q) == pytest.approx(by_terms, abs=1e-7)
