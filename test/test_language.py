"""
The prose keeps to the words of the field: a list of idioms that stay out.

`CLEAN` files have none of them. `LEFT` bounds how many the other files have: lower it whenever
files are cleaned, and move them to `CLEAN`.
"""

from fnmatch import fnmatch
from pathlib import Path
import re
import subprocess

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Idiom -> the field's word.
WORDS = {
    r'what (is|was) left|leaves? over|left over|(error|that) (is|was) left': 'residual, remaining',
    r'(can|could|cannot) be told|tells? (\w+ )?(apart|from)': 'identifiable, distinguishable',
    r'every joint may have beside gravity': 'nuisance term',
    r'nobody': 'unmodelled, unknown, without',
    # Of alternatives; `rivals` is also a key of diagnose --json.
    r'(?<![.\x27])rivals?(?!\x27)': 'alternative',
    r'neighbours are alike': 'autocorrelated samples',
    r'flatter\w*': 'is smaller on fitted data',
    r'(band|interval) holds|hold the truth': 'covers',
    r'holds? (much |best|better)': 'generalises',
    r'gives? way|giving way': 'joint elasticity, yields',
    r'holds? (\w+ )*(arm|robot) up|drops? out of the sky': 'gravity torque',
    r'how right': 'accuracy',
    r'the (model|chain|fit|data|node) (knows?|tells?|remembers|believes?)': 'has, shows',
    r'Sweep|Bent|Workplace|Weighed|other_laws': 'the concept that it holds',
}
PATTERN = re.compile('|'.join(rf'\b(?:{words})\b' for words in WORDS))
CLEAN = (
    'README.md', 'docs/architecture.md', 'docs/dependencies.md', 'docs/diagnosis.md',
    'docs/json.md', 'docs/performance.md', 'docs/report.md', 'docs/solver.md', 'docs/workbench.md',
    'docs/walkthrough.md', 'docs/make_*.py', 'examples/*.py',
    'gravity_comp_ros/__init__.py', 'gravity_comp_ros/api/*', 'gravity_comp_ros/cli.py',
    'gravity_comp_ros/commands/*', 'gravity_comp_ros/commands/usage/*',
    'gravity_comp_ros/display.py', 'gravity_comp_ros/errors.py')
LEFT = 150


def prose(path: Path) -> str:
    """Return the text of a file; of Markdown without code, which has the names of keys."""
    text = path.read_text(encoding='utf-8')
    if path.suffix == '.md':
        text = re.sub(r'```.*?```|`[^`\n]*`', '', text, flags=re.DOTALL)
    return text


def found(path: Path) -> list[str]:
    """Return every idiom in a file, with some text around it."""
    text = re.sub(r'\s', ' ', prose(path))
    return [f'{path.relative_to(ROOT)}: {match[0]!r} in '
            f'...{text[max(0, match.start() - 30):match.end() + 20]!r}'
            for match in PATTERN.finditer(text)]


def files() -> list[Path]:
    listed = subprocess.run(['git', 'ls-files', '*.md', 'gravity_comp_ros/*.py', 'docs/*.py',
                             'examples/*.py'], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip('not in a git checkout')
    return [ROOT / name for name in listed.stdout.splitlines() if (ROOT / name).exists()]


def is_clean(path: Path) -> bool:
    return any(fnmatch(str(path.relative_to(ROOT)), pattern) for pattern in CLEAN)


def test_clean_files_stay_clean():
    hits = [hit for path in files() if is_clean(path) for hit in found(path)]
    assert not hits, '\n'.join(hits)


def test_the_others_get_no_worse():
    hits = [hit for path in files() if not is_clean(path) for hit in found(path)]
    assert len(hits) <= LEFT, '\n'.join(hits)


def test_the_list_sees_what_it_looks_for(tmp_path):
    for text in ('kinematics nobody has told', 'what the chain leaves over is no noise',
                 'the error that is left', 'the band holds 95 %', 'the model knows its error',
                 'rivals', 'how right it is'):
        assert PATTERN.search(text), text
    assert not PATTERN.search('The residual of the chain is not white.')
