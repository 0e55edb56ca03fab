"""External torque of an arm with friction in MuJoCo: free motion, and pushes of known force."""

from bench.external_torque import fitted, free, LIMIT, pushes
import numpy as np
import pytest

RATE, SEED, STANDARD_DEVIATIONS = 100.0, 38, 5.0


@pytest.mark.parametrize('build', ['seven', pytest.param('six', marks=pytest.mark.campaign)])
def test_pushes_are_found_within_50_ms_and_free_motion_is_no_push(build):
    model = fitted(build, SEED, is_plain=False)
    alarms, hours, ratio = free(model, build, SEED, RATE, minutes=2.0)
    assert alarms == 0 and hours > 0.9 * 2.0 / 60.0
    rms, largest = ratio
    assert (rms > 0.2).all() and (rms < 0.7).all() and (largest < 3.0).all()
    judged = pushes(model, build, SEED, RATE, 12, STANDARD_DEVIATIONS)
    delays = np.array([delay for delay, _ in judged])
    assert (delays <= LIMIT).sum() >= 11 and np.isfinite(delays).all()
    # Less is not always found: the size is not far above the limit of what is.
    assert np.median([np.linalg.norm(push.force) for _, push in judged]) < 15.0
