"""Reproduction of the paper: the marks of its tables, and scores by hand on a small scene."""

from bench.paper import baselines
from bench.paper.methods import Fitted, score, worst
from bench.paper.run import PAGE, TABLES, with_table
from bench.paper.scenes import Scene, simulated
from gravity_comp_ros.simulation import arms
import numpy as np
import pytest


@pytest.fixture(scope='module')
def scene() -> Scene:
    return simulated(0)


def test_the_page_has_a_place_for_every_table():
    text = PAGE.read_text()
    for name in TABLES:
        written = with_table(text, name, '| x |')
        assert written != text and f'<!-- {name} -->\n| x |\n<!-- end -->' in written


def test_errors_by_hand(scene):
    def off_by_one(_: Scene) -> Fitted:
        return Fitted(lambda q: arms.gravity_torque(scene.nominal, q) + 1.0, [1] * 7, 5, 0.5)
    row = score('x', off_by_one, scene)
    assert row.inside == pytest.approx([1.0] * 7) and row.anywhere == pytest.approx([1.0] * 7)
    spread = np.ptp(scene.inside.truth[:, 1])
    assert row.nrmse_inside[1] == pytest.approx(1.0 / spread)
    # Joint 1 of the level iiwa has no gravity torque, so its nRMSE is undefined.
    assert np.isnan(row.nrmse_inside[0])
    assert worst([row, row]).seconds == 0.5


def test_baselines_with_known_kinematics_are_accurate(scene):
    assert score('n', baselines.nominal, scene).anywhere.max() < 1e-9
    fitted = score('r', baselines.regression, scene)
    assert fitted.anywhere.max() < 0.3
    wrong = score('e', baselines.explicit, scene)
    assert 0.1 < wrong.anywhere.max() < 3.0
