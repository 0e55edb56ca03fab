"""Reproduction of the paper at small size: every table and figure, and the parts of the bench."""

import re

from bench.paper import baselines
from bench.paper.methods import Fitted
from bench.paper.run import main
from bench.paper.scenes import Scene, simulated, TINY
from bench.paper.score import score, worst
from gravity_comp_ros.simulation import arms
import numpy as np
import pytest


@pytest.fixture(scope='module')
def scene() -> Scene:
    return simulated(0, TINY)


@pytest.mark.campaign
def test_the_page_has_every_table_and_figure(tmp_path):
    page = tmp_path / 'paper.md'
    assert main(['--tiny', '-o', str(page)]) == 0
    text = page.read_text()
    for title in ('## Table 3', '## Eq. (18)', '## Tables 4 and 8', '## Table 5',
                  '## Real recordings'):
        assert title in text
    assert '{' not in text and 'nan' not in text
    for method in ('per_joint', 'potential', 'chain', 'linear regression', 'EFD', 'Pinocchio',
                   'updated from 10 s with a URDF'):
        assert re.search(rf'^\| .*{method}.* \|', text, re.MULTILINE), method
    for figure in ('fig4', 'fig8', 'fig9', 'fig11'):
        drawn = (page.with_suffix('') / f'{figure}.svg').read_text()
        assert drawn.count('<polyline') >= 6 and len(drawn) < 60000
        assert f'paper/{figure}.svg' in text


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
