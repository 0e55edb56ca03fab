"""
Make docs/walkthrough.md: the commands of a walk-through, and what they really printed.

`python3 docs/make_walkthrough.py` runs every command in an empty folder and writes the page.
"""

from __future__ import annotations

import os
from pathlib import Path
import shlex
import subprocess
import sys
import tempfile
import textwrap

PAGE = Path(__file__).resolve().parent / 'walkthrough.md'
ROOT = PAGE.parent.parent
_WIDTH = 110

_ARM = 'gravity_comp synth --motion multisine --max-speed 0.12 --rate 20 --duration 60 --noise 0.1'
_ROUGH = '--hidden coulomb_friction:iiwa_joint_4=0.8'

HEAD = """\
# From a recording to the effect that is missing

Made by `python3 docs/make_walkthrough.py`, which runs every command on this page and puts here
what it printed, with long lines wrapped. No robot is needed: the arm is simulated, and what is
wrong with it is known, so that every answer can be checked.
"""

# A piece of prose, then the commands that it speaks of.
STEPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("""## An arm with unmodelled friction

A KUKA LBR iiwa 7 moves slowly, twice for a minute along different ways, and a third time later.
Its torque sensors have 0.1 N·m of noise, and joint 4 has 0.8 N·m of friction (a LuGre model,
integrated in fine steps: bristles that bend, then slide).
""",
     (f'{_ARM} --seed 1 {_ROUGH} -o run1.mcap',
      f'{_ARM} --seed 2 {_ROUGH} -o run2.mcap',
      f'{_ARM} --seed 1 --start 60 {_ROUGH} -o later.mcap')),
    ("""## Learn gravity, and see where it is wrong

The model is one potential energy, in which friction has no place. So it stays in the error, and
its joint stands out on the third recording, which the model has not seen.
""",
     ('gravity_comp fit run1.mcap run2.mcap -o arm.json --terms 3',
      'gravity_comp compare later.mcap --model arm.json')),
    ("""## What is missing?

The friction is named, on its joint, with its size and 95 % interval; errors are of data that was
not fitted. What else is named is there as well: the simulated arm has mass, so that even slow
motion takes some torque to accelerate it. What the recording cannot show is listed with the
reason.
""",
     ('gravity_comp diagnose run1.mcap run2.mcap --model arm.json',)),
    ("""## Put it in

Gravity and friction are fitted anew together. The error on data that was not fitted falls on joint
4 to the noise of the sensor, and on others that had to make up for the friction.
""",
     ('gravity_comp add coulomb_friction:iiwa_joint_4 --model arm.json run1.mcap run2.mcap',
      'gravity_comp compare later.mcap --model arm.json')),
    ("""## Take it back

The model file remembers what was added, when, and what it brought; the last addition can be
undone.
""",
     ('gravity_comp add --undo --model arm.json',)),
)


def commands() -> list[str]:
    """Return every command of the walk-through, in order."""
    return [command for _, some in STEPS for command in some]


def page(folder: Path) -> str:
    """
    Run every command in a folder and return the page.

    :raises subprocess.CalledProcessError: if a command fails.
    """
    parts = [HEAD]
    for prose, some in STEPS:
        parts.append(prose)
        for command in some:
            parts.append(f'```\n$ {command}\n{output(command, folder)}\n```\n')
    return '\n'.join(parts)


def output(command: str, folder: Path) -> str:
    """Return what a command prints, with long lines wrapped."""
    argv = [sys.executable, '-m', 'gravity_comp_ros.cli', *shlex.split(command)[1:]]
    done = subprocess.run(argv, cwd=folder, check=True, capture_output=True, text=True,
                          env={**os.environ, 'PYTHONPATH': str(ROOT), 'COLUMNS': str(_WIDTH)})
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    return '\n'.join(wrapped(line) for line in lines)


def wrapped(line: str, width: int = _WIDTH) -> str:
    """Return a line on several, what follows indented further."""
    indent = ' ' * (len(line) - len(line.lstrip()) + 4)
    return textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False,
                         break_on_hyphens=False)


def main() -> None:
    """Write the page."""
    with tempfile.TemporaryDirectory() as folder:
        PAGE.write_text(page(Path(folder)), encoding='utf-8')


if __name__ == '__main__':
    main()
