"""README.md shows the output of `fit` and `compare`."""

from pathlib import Path
import re

from gravity_comp_ros.cli import main
import pytest

ROOT = Path(__file__).resolve().parent.parent
NUMBER = re.compile(r'-?\d+(?:\.\d+)?')
# Tolerances of figures, which differ between machines.
RELATIVE, ABSOLUTE = 0.05, 0.02


def shown(verb):
    """Return the output lines of a command in README.md, without shortened ones."""
    text = (ROOT / 'README.md').read_text()
    block = re.search(rf'^\$ gravity_comp {verb} bags/.*\n((?:(?!\$ ).*\n)*?)(?:\n\$ |```)', text,
                      re.MULTILINE)
    lines = [' '.join(line.split()) for line in block[1].splitlines()]
    return [line for line in lines if line and '...' not in line and '──' not in line]


@pytest.fixture(scope='module')
def model(tmp_path_factory):
    return tmp_path_factory.mktemp('readme') / 'arm.json'


@pytest.mark.parametrize(('verb', 'call'), [
    ('fit', ['fit', 'bags/eq17_unloaded.mcap', '-o', 'MODEL']),
    ('compare', ['compare', 'bags/eq17_2kg.mcap', '--model', 'MODEL'])])
def test_the_readme_shows_the_output(model, monkeypatch, capsys, verb, call):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv('COLUMNS', '160')
    assert main([word.replace('MODEL', str(model)) for word in call]) == 0
    printed = [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert len(shown(verb)) >= 6
    for line in shown(verb):
        candidates = [other for other in printed
                      if NUMBER.sub('#', other) == NUMBER.sub('#', line)]
        assert any(close(line, other) for other in candidates), (line, candidates)


def close(line, other):
    return [float(x) for x in NUMBER.findall(line)] == pytest.approx(
        [float(x) for x in NUMBER.findall(other)], rel=RELATIVE, abs=ABSOLUTE)
