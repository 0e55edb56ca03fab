"""Prose and names use the field's standard terms: three sets of expressions that stay out."""

from dataclasses import dataclass
from pathlib import Path
import re
import subprocess

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Nouns that do not say, know, want or hold anything.
_THINGS = (r'(data|motions?|recordings?|samples|residuals?|torques?|gravity|models?|chains?|fits?|'
           r'effects?|nodes?|plans?|diagnos[ie]s|arms?|joints?|descriptions?|urdf|files?|bags?)')

# Expression -> the field's term. Case does not matter; parts of snake_case names count, attributes
# (`.rivals`) and keys (`'rivals'`) do not.
WORDS = {
    r'what (is|was|are|were) left|leaves? over|left over|'
    r'(errors?|that) (is|was|are|were) left(?! out)|'
    r'what (\w+ ){0,2}leaves?|(gravity|chain|model|fit|dynamics|potential) leaves?(?! out)':
        'residual, remaining',
    r'beside(?! friction \[Nm\])': 'jointly with, in addition to; nuisance; next to',
    r'(can|could|cannot|may|to) be told|tells? (\w+ )?(apart|from)|told (apart|of|that|from|by)|'
    r'telling': 'identifiable, distinguish; reported',
    rf'{_THINGS} (says?|said|asks?|tells?|knows?|knew|believes?|doubts?|remembers?|wants?|'
    r'promises?|notices?|forgets?)(?! so\b)': 'gives, reports, contains, requires',
    r'(that|which|it|they) (knows?|knew|believes?|remembers?|wants|tells|doubts)':
        'has, uses, requires, reports',
    r'(data|recordings?|samples|models?|chains?|files?|descriptions?|bags?|fits|motion|gravity) '
    r'(holds?|lacks?)(?![- _]?out)': 'contains, does not contain, does not model',
    r'rivals?(?! ?[:=])': 'alternative',
    r'alike': 'autocorrelated, similar, equally',
    r'neighbours are': 'autocorrelated samples',
    r'(band|interval)s? (holds?|contains?)|hold the truth': 'covers',
    r'holds? (much |best|better)': 'generalises',
    r'holds? (\w+ )*(arm|robot) up|drops? out of the sky': 'gravity torque',
}

# Openings that announce a noun clause where a noun exists, or a unit instead of the quantity.
CLAUSES = {
    r'"""\s?(What|Where|How|Which|Whose|Who|When|Why|Whether)\b': 'a noun phrase',
    r'\bReturns? (what|how|where|which|who|whose)\b': 'Return the <quantity>',
    r'(?<!#)# (What|How|Where|Who|Whose|Which|So (many|much))\b': 'a noun phrase; if',
    r'(?<!#)# (rad|rad/s|N·m|s|m|kg|Hz): ': '# <Quantity>, in <unit>',
}

# Participles and adverbs as names of variables, and of constants.
_NAMES = (r'(found|made|shown|taken|told|said|alike|usual|wanted|left|doubt|worth|many|most|least|'
          r'much)')
NAMES = {
    rf'(?<![\w.])(?!left, (size, )?right\b|left: ){_NAMES}(, \w+)*'
    r'(: [\w[\]|.]+(, [\w[\]|.]+)*)? = '
    rf'|(?<!\w)for {_NAMES} in ':
        'the noun: result, coefficients, samples',
    r'(?<![A-Za-z])_?([A-Z]+_)*(LEAST|MOST|FEWEST|USUAL|MANY|ENOUGH|LIKELIER|ALIKE|MUCH|WORTH)'
    r'(_[A-Z]+)* ?[=,]': 'MIN_..., MAX_..., PRIOR_STD_...',
}


@dataclass(frozen=True)
class RuleSet:
    """Expressions that stay out of files with these endings."""

    pattern: re.Pattern[str]
    suffixes: tuple[str, ...]


TEXT = ('.py', '.md', '.rst', '.sh', '.yaml', '.toml', '.cfg', '.xml', '.js', '')
RULES = {
    'words': RuleSet(re.compile(
        '(?<![A-Za-z.])(?:' + '|'.join(WORDS) + ')(?![A-Za-z])', re.I), TEXT),
    'clauses': RuleSet(re.compile('|'.join(CLAUSES)), ('.py',)),
    'names': RuleSet(re.compile('|'.join(NAMES)), ('.py',)),
}


def prose(path: Path) -> str:
    """Return the text of a file without quoted code and keys."""
    text = path.read_text(encoding='utf-8')
    if path.suffix == '.md':
        text = re.sub(r'```.*?```', '', text, flags=re.DOTALL)
    text = re.sub(r'``[^`]*``|`[^`\n]*`', '', text)
    return re.sub(r'\s', ' ', re.sub(r"'\w+'", "''", text))


def hits_of(path: Path, name: str) -> list[str]:
    """Return every hit of a set of rules in a file, with the text around it."""
    rules = RULES[name]
    if path.suffix not in rules.suffixes:
        return []
    text = prose(path)
    return [f'{path.relative_to(ROOT)}: {match[0]!r} in '
            f'...{text[max(0, match.start() - 35):match.end() + 25]!r}'
            for match in rules.pattern.finditer(text)]


def files() -> list[Path]:
    """Return all files with text of ours, except this one."""
    listed = subprocess.run(['git', 'ls-files'], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip('not in a git checkout')
    paths = [ROOT / name for name in listed.stdout.splitlines() if name != 'LICENSE']
    return [path for path in paths if path.exists() and path.suffix in TEXT
            and path != Path(__file__).resolve()]


@pytest.mark.parametrize('name', list(RULES))
def test_prose_and_names_use_standard_terms(name):
    hits = [hit for path in files() for hit in hits_of(path, name)]
    assert not hits, '\n'.join(hits)
