"""Search for the kinematic order of joints from their torques."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.joint_order_search import joint_order_from_torques
from gravity_comp_ros.models.kinematic.chain import aligned, Chain
import numpy as np
import pytest

NAMES = ('a', 'b', 'c', 'd')


def recorded(seed):
    """Return slow motion of an arm of four joints at right angles, with friction and noise."""
    rng = np.random.default_rng(seed)
    axes = np.stack([aligned(np.array(axis)) for axis in (
        (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))])
    chain = Chain(axes, np.array([[40.0, 5.0], [1.0, 20.0], [8.0, 2.0], [1.0, 3.0]]))
    t = np.arange(0.0, 90.0, 0.2)
    phase, speed = rng.uniform(0.0, 6.0, 4), rng.uniform(0.05, 0.11, 4)
    q = np.sin(np.outer(t, speed) * 2.0 + phase)
    qd = 2.0 * speed * np.cos(np.outer(t, speed) * 2.0 + phase)
    tau = chain.torque(q) + 0.5 * np.tanh(qd / 0.01) + 0.05 * rng.standard_normal(q.shape)
    return JointSamples.single_run(NAMES, t, q, qd, tau)


@pytest.mark.parametrize('seed', range(3))
def test_a_wrong_order_is_corrected(seed):
    samples = recorded(seed)
    shuffled = list(np.random.default_rng(seed + 100).permutation(NAMES))
    if tuple(shuffled) == NAMES:
        shuffled.reverse()
    assert joint_order_from_torques(samples.joints(shuffled)) == NAMES


def test_the_right_order_is_kept():
    assert joint_order_from_torques(recorded(0)) is None
