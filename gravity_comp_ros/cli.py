"""Entry point of `gravity_comp VERB`: dispatches to the verb's module and reports its errors."""

from __future__ import annotations

from collections.abc import Sequence
import importlib
import io
import os
import shlex
import sys
import traceback

from gravity_comp_ros import __version__
from gravity_comp_ros.commands import summary, VERBS
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.printable import printable

PROGRAM = 'gravity_comp'

HELP = 'Learn the gravity torque of a robot arm from recorded joint states, and evaluate the ' \
    'model.'
EXAMPLE = """\
the loop:
  gravity_comp info run1.mcap
  gravity_comp fit run1.mcap -o arm.json
  gravity_comp compare run2.mcap --model arm.json
  gravity_comp diagnose run2.mcap --model arm.json
  gravity_comp add coulomb_friction:elbow --model arm.json run2.mcap
  gravity_comp workbench run1.mcap run2.mcap        the same in a browser

without a robot: gravity_comp synth --help

`gravity_comp VERB --help` lists the options and examples of a verb.
Exit status: 0 done, 1 failed (one line gives the reason), 2 wrong usage.
With GRAVITY_COMP_DEBUG=1 a failure also prints its traceback.
"""

# Install command by Python module. Only the verb that needs a missing module fails.
PACKAGES = {
    'bokeh': 'pip install bokeh',
    'defusedxml': 'pip install defusedxml (in a ROS workspace: python3-defusedxml)',
    'lz4': 'pip install lz4 (in a ROS workspace: python3-lz4)',
    'dask': 'pip install distributed',
    'distributed': 'pip install distributed',
    'mcap': 'pip install mcap zstandard lz4 (in a ROS workspace: README.md, On the robot)',
    'mujoco': 'pip install mujoco',
    'pinocchio': 'pip install pin (in a ROS workspace: ros-jazzy-pinocchio)',
    'rclpy': 'source ROS 2 Jazzy, or use the .venv that `make venv` makes',
    'rich': 'pip install rich',
    'scipy': 'pip install scipy',
    'shtab': 'pip install shtab (or: apt install python3-shtab)',
    'yaml': 'pip install PyYAML',
    'zstandard': 'pip install zstandard',
}

# The problems are too small for BLAS threads: on a busy machine they slowed a fit from 6 s to
# 88 s. Set before NumPy is loaded; a setting of the user takes precedence.
THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')

EXIT_INTERRUPTED = 130
EXIT_PIPE_CLOSED = 141


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run the program and return its exit status.

    :param argv: arguments after the program's name; None for those of the process.
    """
    argv = list(sys.argv[1:] if argv is None else argv)
    for name in THREADS:
        os.environ.setdefault(name, '1')
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A character that the terminal cannot encode must not raise an error.
            stream.reconfigure(errors='replace')
    verb = argv[0] if argv and argv[0] in VERBS else ''
    who = f'{PROGRAM} {verb}'.rstrip()
    try:
        status = _run_verb(verb, argv[1:]) if verb else _overview(argv)
        sys.stdout.flush()
        return status
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else int(bool(leaving.code))
    except KeyboardInterrupt:
        return _fail(who, 'interrupted', EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader (`| head`) has closed the pipe; suppress Python's own error at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_PIPE_CLOSED
    except Exception as error:
        return _fail(who, _one_line(error))


def _overview(argv: list[str]) -> int:
    """Print help or the version, or report an unknown verb or option."""
    given = argv[0] if argv else '--help'
    if given == '--version':
        print(f'{PROGRAM} {__version__}')
    elif given in ('-h', '--help'):
        verbs = ''.join(f'  {verb:<10} {summary(verb)}\n' for verb in VERBS)
        print(f'usage: {PROGRAM} VERB ...\n\n{HELP}\n\nverbs:\n{verbs}\n{EXAMPLE}', end='',
              file=sys.stdout if argv else sys.stderr)
    else:
        what = 'option' if given.startswith('-') else 'verb'
        return _fail(PROGRAM, f'unknown {what} {given}; the verbs are {", ".join(VERBS)} (see '
                              f'`{PROGRAM} --help`)', 2)
    return 0 if argv else 2


def _run_verb(verb: str, argv: list[str]) -> int:
    # Numerical modules are imported only now, when the number of threads is set.
    from gravity_comp_ros.commands.arguments import verb_parser
    from gravity_comp_ros.commands.html import write_lines
    from gravity_comp_ros.commands.outputs import check_outputs
    parser = verb_parser(verb)
    parser.set_defaults(command=shlex.join([PROGRAM, verb, *argv]), parser=parser)
    # Options may appear between positional arguments.
    args = parser.parse_intermixed_args(argv)
    check_outputs(args)
    try:
        answer = importlib.import_module(f'gravity_comp_ros.commands.{verb}').run(args)
    except GravityCompError as problem:
        if getattr(args, 'html', None) is not None:
            write_lines(args.html, str(problem), [])
        raise
    return answer if isinstance(answer, int) else int(answer.give(args.json))


def _one_line(error: Exception) -> str:
    """Return the error message for the user."""
    if isinstance(error, GravityCompError):
        return str(error)
    if isinstance(error, ImportError):
        missing = (error.name or '').split('.')[0]
        if missing in PACKAGES:
            return f'needs the Python module {missing}, which cannot be imported ({error}): ' \
                   f'{PACKAGES[missing]}'
    if isinstance(error, MemoryError):
        return 'not enough memory: use fewer or shorter recordings'
    if isinstance(error, OSError) and error.strerror:
        where = f': {os.fsdecode(error.filename)}' if error.filename is not None else ''
        return f'{error.strerror}{where}'
    return (f'internal error, please report it: {type(error).__name__}: {error} '
            '(GRAVITY_COMP_DEBUG=1 prints the traceback)')


def _fail(who: str, message: str, status: int = 1) -> int:
    if os.environ.get('GRAVITY_COMP_DEBUG') == '1':
        traceback.print_exc()
    try:
        print(f'{who}: {printable(message)}', file=sys.stderr, flush=True)
    except OSError:
        pass  # the reader has closed the pipe; the exit status reports the failure
    return status


if __name__ == '__main__':
    sys.exit(main())
