"""The bags in bags/, against the output of their commands."""

import os
from pathlib import Path
import shlex
import subprocess

from gravity_comp_ros.cli import main
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np
import pytest

BAGS = Path(__file__).resolve().parents[3] / 'bags'
FILES = sorted(path.name for path in BAGS.glob('*.mcap'))


@pytest.fixture(scope='module')
def remade(tmp_path_factory):
    """Return a folder with the bags of the commands that the script runs."""
    folder = tmp_path_factory.mktemp('bags')
    done = subprocess.run([str(BAGS / 'make.sh'), str(folder)], check=True, text=True,
                          capture_output=True, env={**os.environ, 'GRAVITY_COMP': 'echo'})
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for line in done.stdout.splitlines():
            assert main(shlex.split(line)) == 0
    return folder


def test_the_script_makes_all_bags(remade):
    assert len(FILES) == 5
    assert sorted(path.name for path in remade.iterdir()) == FILES


@pytest.mark.parametrize('name', FILES)
def test_same_samples_when_made_again(remade, name):
    kept, again = read_bag(BAGS / name), read_bag(remade / name)
    assert kept.samples.names == again.samples.names
    assert kept.report.start_ns == again.report.start_ns
    for field in ('t', 'q', 'qd', 'tau'):
        # Rounding depends on the version of the rigid-body library.
        np.testing.assert_allclose(getattr(kept.samples, field), getattr(again.samples, field),
                                   rtol=1e-9, atol=1e-9)


def test_readme_has_the_commands_of_the_script():
    script = [line.split(' ', 1)[1] for line in (BAGS / 'make.sh').read_text().splitlines()
              if line.startswith('$comp ')]
    readme = (BAGS / 'README.md').read_text()
    assert len(script) == 5
    for arguments in script:
        assert f'`gravity_comp {arguments}`' in readme
