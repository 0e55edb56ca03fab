"""
Write docs/walkthrough.md: the commands of a walk-through with their output.

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

`python3 docs/make_walkthrough.py` writes this page: it runs every command and copies its output,
with long lines wrapped. No robot is required: the arm is simulated with known effects, so that
every result can be verified.
"""

# Text of each section, and its commands.
STEPS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("""## An arm with unmodelled friction

A KUKA LBR iiwa 7 moves slowly along two different paths of a minute, and a third time later. Its
torque sensors have 0.1 N·m of noise, and joint 4 has 0.8 N·m of friction (a LuGre model,
integrated in fine steps).
""",
     (f'{_ARM} --seed 1 {_ROUGH} -o run1.mcap',
      f'{_ARM} --seed 2 {_ROUGH} -o run2.mcap',
      f'{_ARM} --seed 1 --start 60 {_ROUGH} -o later.mcap')),
    ("""## Fit gravity and compare

A gravity model cannot represent friction. Friction therefore remains in the residual, and its
joint has a large error on the third recording, which was not fitted.
""",
     ('gravity_comp fit run1.mcap run2.mcap -o arm.json --terms 3',
      'gravity_comp compare later.mcap --model arm.json')),
    ("""## Diagnose missing effects

`diagnose` identifies the friction, its joint and its size with a 95 % interval. Errors are
held-out errors. Other findings are real as well: the links have inertia, so that even slow motion
requires some acceleration torque. Effects that are not identifiable from the recordings are listed
with the reason.
""",
     ('gravity_comp diagnose run1.mcap run2.mcap --model arm.json',)),
    ("""## Add the effect

`add` refits gravity and friction jointly. The held-out error of joint 4 decreases to the sensor
noise. The errors of other joints decrease if their gravity terms had absorbed part of the
friction.
""",
     ('gravity_comp add coulomb_friction:iiwa_joint_4 --model arm.json run1.mcap run2.mcap',
      'gravity_comp compare later.mcap --model arm.json')),
    ("""## Undo the addition

The model file stores every addition with its date and its errors. The last addition can be undone.
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
    """Return the output of a command, with long lines wrapped."""
    argv = [sys.executable, '-m', 'gravity_comp_ros.cli', *shlex.split(command)[1:]]
    done = subprocess.run(argv, cwd=folder, check=True, capture_output=True, text=True,
                          env={**os.environ, 'PYTHONPATH': str(ROOT), 'COLUMNS': str(_WIDTH)})
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    return '\n'.join(wrapped(line) for line in lines)


def wrapped(line: str, width: int = _WIDTH) -> str:
    """Return a wrapped line, with continuation lines indented further."""
    indent = ' ' * (len(line) - len(line.lstrip()) + 4)
    return textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False,
                         break_on_hyphens=False)


def main() -> None:
    """Write the page."""
    with tempfile.TemporaryDirectory() as folder:
        PAGE.write_text(page(Path(folder)), encoding='utf-8')


if __name__ == '__main__':
    main()
