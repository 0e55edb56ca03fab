"""Verbs of the command line with their descriptions; imports no verb."""

VERBS = {
    'synth': 'record a simulated arm with motion, payload, hidden effects and noise',
    'convert': 'convert a CSV or NPZ file with any columns, units and signs to an MCAP file',
    'cut': 'extract a part of a recording by time and joints, or split it',
    'info': 'list joints, speeds and coverage of a recording, and its limitations',
    'fit': 'learn the gravity model of an arm from slow motion',
    'compare': 'compare the torque of a model with measured torque, for each joint',
    'diagnose': 'identify physical effects missing from a gravity model, with their size',
    'add': 'add effects to a model, refit it, and compare held-out errors',
    'update': 'update a model after a payload change, from ten seconds of slow motion',
    'check': 'check a robot description against recorded torque, for faults',
    'calibrate': 'calibrate efforts in N·m with a known weight',
    'export': 'write a model as C source, into a URDF or MJCF, or as payload of a drive',
    'replay': 'write measured, predicted and residual torque to an MCAP file for PlotJuggler or '
              'Foxglove',
    'plan': 'plan the motion that resolves open findings',
    'fleet': 'fit or diagnose every robot of a folder, locally or on a Dask cluster',
    'workbench': 'compare, diagnose, add effects and undo, in a browser',
    'completion': 'print a shell completion script for verbs, options and files',
}
