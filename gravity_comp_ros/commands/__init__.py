"""
Command-line programs of this package, a module for each verb.

The docstring of a module is the help text of its verb. `add_arguments(parser)` adds its
arguments, and `run(args)` returns its result.
"""

import ast
from pathlib import Path

# In the order of the overview.
VERBS = ('synth', 'convert', 'cut', 'info', 'fit', 'compare', 'diagnose', 'add', 'update', 'plan',
         'replay', 'check', 'calibrate', 'export', 'fleet', 'workbench', 'completion')


def summary(verb: str) -> str:
    """Return the description of a verb in one line, without an import of its module."""
    source = Path(__file__).with_name(f'{verb}.py').read_text(encoding='utf-8')
    return (ast.get_docstring(ast.parse(source)) or '').partition('\n')[0]
