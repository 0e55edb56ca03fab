"""Diagnosis of a serial arm whose recordings hardly separate effects from gravity."""

from functools import cache

from bench.planning.scenes import Scene, wide_motion
from bench.shared.campaign import campaign
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import FOUND, Verdict
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
import pytest


@cache
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


@pytest.mark.parametrize('arm', ['right_six', *campaign('right_seven')])
def test_an_offset_is_established_with_wide_motion_and_nothing_else_in_narrow_motion(arm):
    scene = Scene(arm, 'torque_offset', 3, 'narrow', 21)
    narrow, wide = (of_joint(scene, samples)
                    for samples in (scene.recorded(), with_wide_motion(scene)))
    # One that gravity absorbs in narrow motion is predicted with it, and not missing later.
    if not poor_model(scene).applied.has('torque_offset', scene.arm_model.joints[3]):
        assert wide['torque_offset'].verdict == Verdict.ESTABLISHED
    named = [f for f in (*narrow.values(), *wide.values()) if f.verdict in FOUND]
    assert named
    for finding in named:
        assert finding.effect == 'torque_offset'
        low, high = finding.coefficients['b'].ci95
        assert low < 1.5 < high
