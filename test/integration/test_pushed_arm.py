"""External torque of an arm with friction in MuJoCo: free motion, and pushes of known force."""

from bench.external_torque import fitted, free, LIMIT, pushes
import numpy as np
import pytest

RATE, STANDARD_DEVIATIONS = 100.0, 5.0


@pytest.mark.parametrize(('build', 'seed'), [
    ('seven', 38), pytest.param('six', 39, marks=pytest.mark.campaign)])
def test_pushes_are_found_within_50_ms_and_free_motion_is_no_push(build, seed):
    model = fitted(build, seed, 45.0)
    alarms, hours, ratio = free(model, build, seed, RATE, minutes=0.5)
    assert alarms == 0 and hours > 0.9 * 0.5 / 60.0
    rms, largest = ratio
    assert (rms > 0.15).all() and (rms < 0.7).all() and (largest < 3.0).all()
    judged = pushes(model, build, seed, RATE, 8, STANDARD_DEVIATIONS)
    delays = np.array([delay for delay, _ in judged])
    assert (delays <= LIMIT).sum() >= 7 and np.isfinite(delays).all()
    # It does not find them because they are large: friction alone is 1 N·m.
    assert np.median([push.std for _, push in judged], axis=0).max() < 1.0
