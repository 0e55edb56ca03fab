"""
Verbs of the command line: description, help text and arguments.

These modules import no numerical code, so that help and messages on wrong usage are fast.
"""

from gravity_comp_ros.commands.arguments import VERBS
from gravity_comp_ros.commands.usage import files, loop, tools

__all__ = ['files', 'loop', 'tools', 'VERBS']
