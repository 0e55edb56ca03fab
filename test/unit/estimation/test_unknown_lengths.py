"""The dynamic torque of an arm of unknown lengths, in the loop."""

from dataclasses import replace

from bench.cases.cases import ARMS
from bench.cases.generated import generated_arm
from bench.shared.fast_arms import NOISE, of_motion, recording
import gravity_comp_ros as gc
from gravity_comp_ros.data.differentiation import accelerations
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
import pytest


@pytest.mark.campaign
@pytest.mark.parametrize('arm, seed', [('iiwa7', 2), ('six_axis', 2), ('right_seven', 1)])
def test_dynamics_that_are_added_are_those_of_the_arm(arm, seed):
    arm = ARMS[arm]()
    runs = concatenate([recording(arm, 10 * seed + k, 40.0, 50.0) for k in range(3)])
    data = gc.Recording(runs, gate=None)
    friction = [f'{name}:{joint}' for joint in arm.joints
                for name in ('coulomb_friction', 'viscous_friction')]
    model = gc.Model(fit(runs, FitOptions('chain')).model)
    added = gc.add_effects(model, data,
                           ['rigid_body_dynamics', *friction], all_samples=True)
    later = recording(arm, 10 * seed + 9, 20.0, 50.0)
    qdd = accelerations(later)
    truth = of_motion(arm, later.q, later.qd, qdd)
    moving = [e for e in added.gravity.applied.effects if e.name == 'rigid_body_dynamics']
    alone = replace(added.gravity, applied=replace(added.gravity.applied, effects=tuple(moving)))
    error = (effect_torque(alone, later) - truth).std(axis=0)
    assert (error < 0.1 * truth.std(axis=0).max()).all(), (error, truth.std(axis=0))


@pytest.mark.campaign
def test_fast_motion_of_an_arm_without_a_description_is_explained():
    arm = generated_arm(22, 4)
    runs = concatenate([recording(arm, k, 15.0, 50.0) for k in range(2)])
    data = gc.Recording(runs, gate=None)
    model = gc.fit(data)
    findings = gc.diagnose(data, model).findings
    accepted = [f for f in findings if f.verdict in (gc.Verdict.ESTABLISHED, gc.Verdict.LIKELY)]
    names = {f.effect for f in accepted}
    assert {'rigid_body_dynamics', 'coulomb_friction'} <= names
    # No single law has the shape of bristles at a reversal.
    assert names <= {'rigid_body_dynamics', 'coulomb_friction', 'viscous_friction',
                     'stribeck_friction', 'presliding_hysteresis'}
    better = gc.add_effects(model, data, accepted, all_samples=True)
    later = gc.Recording(recording(arm, 90, 15.0, 50.0), gate=None)
    before, after = (gc.compare(m, later).joints for m in (model, better))
    for name in before:
        assert before[name].rmse > 5.0 * NOISE
        assert after[name].rmse < 2.0 * NOISE
