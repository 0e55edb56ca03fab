"""The verbs and what each does; light, so that an overview loads none of them."""

VERBS = {
    'synth': 'record a simulated arm: model, motion, payload, hidden effects and noise to a file',
    'convert': 'bring a CSV or NPZ file with any columns, units and signs into an MCAP file',
    'cut': 'write a part of a recording, by time and joints, or split it',
    'info': 'say what is in a recording, and what cannot be judged from it',
    'fit': 'learn the gravity model of an arm from slow motion',
    'compare': 'compare a model with measured torques, joint by joint',
    'diagnose': 'name the physical effect that a gravity model is missing, with its size',
    'add': 'add effects to a model, refit it as a whole, and see the held-out error fall',
    'update': 'relearn after a payload change, from ten seconds of slow motion',
    'replay': 'write measured, predicted and residual torque to an MCAP file for PlotJuggler or '
              'Foxglove',
    'plan': 'plan the motion that settles what recordings leave open',
    'fleet': 'fit or diagnose every robot of a folder, here or on a Dask cluster',
    'workbench': 'see where a model fails, add effects and watch the error fall, in a browser',
    'completion': 'print what lets a shell complete verbs, options and files',
}
