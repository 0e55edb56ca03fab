"""
Make docs/pictures/loop.svg: the loop in a terminal, with the real output of the commands.

`python3 docs/make_terminal.py` runs the commands of the walk-through in an empty folder. Outputs
are cut where the picture shows `...`.
"""

from __future__ import annotations

import io
from pathlib import Path
import tempfile

from make_walkthrough import commands, output
from rich.console import Console
from rich.text import Text

PICTURE = Path(__file__).resolve().parent / 'pictures' / 'loop.svg'
_WIDTH = 112
# Verb, index of its call, start of the first line shown, and number of lines.
SHOWN = (('compare', 0, 'error of the model', 11), ('diagnose', 0, '', 2),
         ('diagnose', 0, 'missing effects', 7), ('add', 0, 'held-out error', 11))


def main() -> None:
    """Run the commands and write the picture."""
    console = Console(record=True, width=_WIDTH, file=io.StringIO(), force_terminal=True)
    with tempfile.TemporaryDirectory() as folder:
        outputs = [(command, output(command, Path(folder))) for command in commands()]
    last = ''
    for verb, which, first, count in SHOWN:
        command, text = [pair for pair in outputs if pair[0].split()[1] == verb][which]
        if command != last:
            console.print(Text(f'$ {command}', style='bold green', overflow='fold'))
            last = command
        lines = text.splitlines()
        start = next(k for k, line in enumerate(lines) if line.strip().startswith(first))
        for line in lines[start:start + count]:
            console.print(Text(line, no_wrap=True, overflow='crop'))
        console.print(Text('...', style='dim'))
    PICTURE.write_text(console.export_svg(title='gravity_comp', unique_id='loop'))


if __name__ == '__main__':
    main()
