"""The program of `make demo`, with the node in a separate process and messages over DDS."""

from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEADLINE = 400.0


@pytest.fixture(scope='module')
def demo():
    return subprocess.run([sys.executable, str(ROOT / 'examples' / 'demo.py')],
                          capture_output=True, text=True, timeout=DEADLINE, cwd=ROOT)


@pytest.fixture(scope='module')
def table(demo):
    """Return the rows of the printed table: learned, stale, after 10 s, after 75 s, in N·m."""
    rows = re.findall(r'^ ?(iiwa_joint_\d)((?: +\d+\.\d{3}){4})', demo.stdout, re.MULTILINE)
    return {name: [float(cell) for cell in cells.split()] for name, cells in rows}


def test_demo_succeeds_quietly(demo):
    assert demo.returncode == 0, demo.stdout + demo.stderr
    assert demo.stderr == ''
    assert 'Worst joint with the stale model: iiwa_joint_2' in demo.stdout


def test_every_joint_is_in_the_table(table):
    assert sorted(table) == [f'iiwa_joint_{n}' for n in range(1, 8)]


def test_the_payload_raises_the_error_and_relearning_lowers_it(table):
    # 2 kg at the flange are about 10 N·m at the shoulder on this motion; 0.1 N·m is noise.
    learned, stale, quick, relearned = table['iiwa_joint_2']
    assert stale > 5.0 and quick < stale / 2
    for learned, stale, quick, relearned in table.values():
        assert learned < 0.2 and relearned < 0.2
