"""
Verbs of the command line: description, help text and arguments.

These modules import no numerical code, so that help and messages on wrong usage are fast.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

from gravity_comp_ros.commands.usage import loop, recordings, tools


@dataclass(frozen=True)
class Verb:
    """Description in one line, text after the options, and the function that adds these."""

    text: str
    epilog: str
    add_arguments: Callable[[argparse.ArgumentParser], None]


VERBS = {
    'synth': Verb('record a simulated arm with motion, payload, hidden effects and noise',
                  recordings.SYNTH, recordings.synth),
    'convert': Verb('convert a CSV or NPZ file with any columns, units and signs to an MCAP file',
                    recordings.CONVERT, recordings.convert),
    'cut': Verb('extract a part of a recording by time and joints, or split it',
                recordings.CUT, recordings.cut),
    'info': Verb('list joints, speeds and coverage of a recording, and its limitations',
                 recordings.INFO, recordings.info),
    'fit': Verb('learn the gravity model of an arm from slow motion', loop.FIT, loop.fit),
    'compare': Verb('compare the torque of a model with measured torque, for each joint',
                    loop.COMPARE, loop.compare),
    'diagnose': Verb('identify physical effects missing from a gravity model, with their size',
                     loop.DIAGNOSE, loop.diagnose),
    'add': Verb('add effects to a model, refit it, and compare held-out errors',
                loop.ADD, loop.add),
    'update': Verb('update a model after a payload change, from ten seconds of slow motion',
                   loop.UPDATE, loop.update),
    'check': Verb('check a robot description against recorded torque, for faults',
                  tools.CHECK, tools.check),
    'calibrate': Verb('calibrate efforts in N·m with a known weight, or the stiffness of servos',
                      tools.CALIBRATE, tools.calibrate),
    'export': Verb('write a model as C source, into a URDF or MJCF, or as payload of a drive',
                   tools.EXPORT, tools.export),
    'replay': Verb('write measured, predicted and residual torque to an MCAP file for PlotJuggler '
                   'or Foxglove', loop.REPLAY, loop.replay),
    'plan': Verb('plan the motion that resolves open findings', loop.PLAN, loop.plan),
    'fleet': Verb('fit or diagnose every robot of a folder, locally or on a Dask cluster',
                  tools.FLEET, tools.fleet),
    'workbench': Verb('compare, diagnose, add effects and undo, in a browser',
                      tools.WORKBENCH, tools.workbench),
    'completion': Verb('print a shell completion script for verbs, options and files',
                       tools.COMPLETION, tools.completion),
}
