"""The arms of the campaign: an iiwa with seven axes, and an arm like a UR10 with six."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
import tempfile

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.simulation.arms import Arm, from_urdf, gravity_torque, iiwa7
from gravity_comp_ros.simulation.motions import eq17, Motion, multisine, MultisineOptions
import numpy as np

NOISE = 0.1
# Masses of the links in kg and centres of mass in m, in the frames of the joints.
_SIX = ((7.8, '0 0 0'), (12.9, '-0.3 0 0.17'), (3.9, '-0.28 0 0.05'), (2.0, '0 -0.05 0'),
        (2.0, '0 0.05 0'), (1.2, '0.02 0 -0.02'))


@dataclass(frozen=True)
class TestArm:
    """An arm, and its slow motion of a duration and a rate from a start, s."""

    __test__ = False
    arm: Arm
    motion: Callable[[float, float, float], Motion]

    def recording(self) -> JointSamples:
        """Return 100 s of slow motion without payload, with noise."""
        part = self.motion(100.0, 5.0, 0.0)
        tau = gravity_torque(self.arm, part.q)
        tau += NOISE * np.random.default_rng(5).standard_normal(tau.shape)
        return JointSamples.single_run(self.arm.joints, part.t, part.q, part.qd, tau)


def seven() -> TestArm:
    """Return the iiwa with the motion of Eq. (17) of Yu 2022."""
    return TestArm(iiwa7(), eq17)


def six() -> TestArm:
    """Return an arm with the axes of a UR10, with a multisine motion."""
    from bench.real_robots.arms import data_sheet_urdf
    text = data_sheet_urdf('ur10', tuple(f'joint_{k}' for k in range(1, 7)))
    for mass, centre in _SIX:
        text = text.replace('<inertial><mass value="1"/>',
                            f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>', 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'six.urdf'
        path.write_text(text)
        arm = from_urdf(path)
    lower, upper = np.full(6, -1.2), np.full(6, 1.2)

    def motion(seconds: float, rate: float, start: float) -> Motion:
        return multisine(lower, upper, np.full(6, 1.0), 3, MultisineOptions(max_speed=0.12),
                         seconds, rate, start)
    return TestArm(arm, motion)


ARMS = {'seven': seven, 'six': six}
