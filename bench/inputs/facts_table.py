"""
Table of all facts over recordings: those of the tests, and files of a folder, such as real ones.

    python3 -m bench.inputs.facts_table [FOLDER...]

The recordings are those of `bags`, the iiwa7 along another motion with one hidden effect after
another, and the MCAP, .db3 and CSV files of the folders. A table without times has 100 rows per
second.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import redirect_stderr, redirect_stdout
import io
from pathlib import Path
import sys
import tempfile

from gravity_comp_ros.api.arm import known_arm
from gravity_comp_ros.api.read import arm_facts
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.cli import main as gravity_comp
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.facts.fact import Fact
from gravity_comp_ros.facts.motion import describe
from gravity_comp_ros.planning.enough import enough_motion
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.simulation.hidden import KINDS

BAGS = Path(__file__).resolve().parents[2] / 'bags'
ENDINGS = ('.mcap', '.db3', '.csv')


def facts_of(path: Path) -> list[Fact]:
    """Return all facts of a file, as `info` prints them."""
    if path.suffix == '.csv':
        table = path
        path = Path(tempfile.mkdtemp()) / 'table.mcap'
        for rate in ([], ['--rate', '100']):
            quiet(['convert', str(table), *rate, '-o', str(path)])
    options = ReadOptions(refuse=False)
    read = read_bag(path, options)
    data = Recording(read.samples, reports=(read.report,))
    arm = known_arm(data)
    motion = enough_motion(arm.of(data).samples, arm.axes.geometry).facts()
    return [*read.report.facts, *arm_facts(data, arm),
            *describe(read.samples).motion, *motion]


def simulated(folder: Path) -> Iterator[Path]:
    """Yield a recording of the arm with friction, and one with each effect in addition."""
    for effect in ('', *KINDS):
        path = folder / f'{effect or "friction"}.mcap'
        where = '' if effect and KINDS[effect].whole_arm else ':4'
        hidden = ['coulomb_friction:2', *([f'{effect}{where}'] if effect else [])]
        quiet(['synth', '--motion', 'multisine', '--rate', '20', '--noise', '0.1',
               *(word for each in hidden for word in ('--hidden', each)), '-o', str(path)])
        yield path


def quiet(call: list[str]) -> None:
    """Run a command without its output."""
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        gravity_comp(call)


def rows(paths: Iterable[Path]) -> Iterator[tuple[str, str]]:
    """Yield name and facts of each file."""
    for path in paths:
        try:
            words = '; '.join(f'{fact.kind.value} ({fact.action.value}): {fact.evidence}'
                              for fact in facts_of(path)) or '–'
        except GravityCompError as error:
            words = f'error: {error}'
        yield path.name, words.replace('|', '/')


def main() -> None:
    print('| recording | facts |\n|---|---|')
    given = [path for name in sys.argv[1:] for path in sorted(Path(name).rglob('*'))
             if path.suffix in ENDINGS]
    with tempfile.TemporaryDirectory() as folder:
        for name, words in rows([*sorted(BAGS.glob('*.mcap')), *given,
                                 *simulated(Path(folder))]):
            print(f'| {name} | {words} |', flush=True)


if __name__ == '__main__':
    main()
