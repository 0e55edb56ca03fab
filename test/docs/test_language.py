"""Prose and names use the field's standard terms: the others stay out."""

from pathlib import Path
import re
import subprocess

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = ('.py', '.md', '.rst', '.sh', '.yaml', '.toml', '.cfg', '.xml', '.js', '')
# Nouns that do not say, know, want or hold anything.
_THINGS = (r'(data|motions?|recordings?|samples|residuals?|torques?|gravity|models?|chains?|fits?|'
           r'effects?|nodes?|plans?|diagnos[ie]s|arms?|joints?|descriptions?|urdf|files?|bags?)')
# Expressions, and the field's term. Case does not matter; parts of snake_case names count,
# attributes (`.rivals`) and keys (`'rivals'`) do not.
WORDS = {
    r'what (is|was|are|were) left|leaves? over|left over|what (\w+ ){0,2}leaves?|'
    r'(errors?|that) (is|was|are|were) left(?! out)': 'residual, remaining',
    r'beside(?! friction \[Nm\])': 'jointly with, in addition to; nuisance; next to',
    r'(can|could|cannot|may|to) be told|tells? (\w+ )?(apart|from)|told (apart|of|that|from|by)|'
    r'telling': 'identifiable, distinguish; reported',
    rf'{_THINGS} (says?|said|asks?|tells?|knows?|knew|believes?|doubts?|remembers?|wants?|'
    r'promises?|forgets?)(?! so\b)': 'gives, reports, contains, requires',
    r'(that|which|it|they) (knows?|knew|believes?|remembers?|wants|tells|doubts)': 'has, uses',
    r'rivals?(?! ?[:=])': 'alternative',
    r'alike|neighbours are': 'autocorrelated, similar, equally',
    r'(band|interval)s? (holds?|contains?)|hold the truth': 'covers',
    r'holds? (much |best|better)': 'generalises',
    r'holds? (\w+ )*(arm|robot) up': 'gravity torque',
}
PATTERN = re.compile('(?<![A-Za-z.])(?:' + '|'.join(WORDS) + ')(?![A-Za-z])', re.I)


def prose(path: Path) -> str:
    """Return the text of a file without quoted code and keys."""
    text = path.read_text(encoding='utf-8')
    if path.suffix == '.md':
        text = re.sub(r'```.*?```', '', text, flags=re.DOTALL)
    text = re.sub(r'``[^`]*``|`[^`\n]*`', '', text)
    return re.sub(r'\s', ' ', re.sub(r"'\w+'", "''", text))


def test_prose_and_names_use_standard_terms():
    listed = subprocess.run(['git', 'ls-files'], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip('not in a git checkout')
    paths = [ROOT / name for name in listed.stdout.splitlines() if name != 'LICENSE']
    hits = [f'{path.relative_to(ROOT)}: {match[0]!r} in ...{text[max(0, match.start() - 35):]:.70}'
            for path in paths if path.exists() and path.suffix in TEXT
            and path != Path(__file__).resolve()
            for text in [prose(path)] for match in PATTERN.finditer(text)]
    assert not hits, '\n'.join(hits)
