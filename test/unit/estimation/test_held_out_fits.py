"""Held-out errors of a refit are those of models like the final one."""

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import add_to_model, fit_model
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import iiwa7
from gravity_comp_ros.simulation.hidden import hidden
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import pytest

ARM = iiwa7()


def run(seed):
    """Return a minute of slow motion with friction on joint 4, as in docs/first_hour.md."""
    motion = motions.multisine(ARM.lower, ARM.upper, ARM.max_speed, seed,
                               motions.MultisineOptions(0.12), 60.0, 20.0)
    friction = hidden('coulomb_friction:iiwa_joint_4=0.8', ARM).disturbance
    return synthesise(ARM, motion, SynthesisOptions(NoiseOptions(0.0, 0.1), seed,
                                                    disturbances=(friction,)))


@pytest.mark.campaign
@pytest.mark.parametrize('seeds', [(1, 2), (11, 12), (5, 6)])
def test_held_out_errors_are_near_the_noise(seeds):
    recording = Recording(concatenate([run(seed) for seed in seeds]))
    added = add_to_model(fit_model(recording)[0].model, recording,
                         ['coulomb_friction:iiwa_joint_4'])
    errors = [added.errors[name] for name in ARM.joints]
    # The noise is 0.1 N·m.
    assert max(error.after for error in errors) < 0.35
    assert all(error.after < 1.05 * error.before for error in errors[1:])
    assert errors[3].after < 0.3 * errors[3].before
