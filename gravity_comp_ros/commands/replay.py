"""
Write measured, predicted and residual torque to an MCAP file for PlotJuggler or Foxglove.

topics of the output, all sensor_msgs/JointState:
  /joint_states              effort = measured torque, N·m
  /gravity_comp/prediction   effort = torque of the model, gravity and effects, N·m
  /gravity_comp/residual     effort = measured minus predicted torque, N·m

For example:
  gravity_comp replay run2.mcap --model arm.json -o out.mcap
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from gravity_comp_ros.commands import arguments
from gravity_comp_ros.commands.reading import scale_warnings
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.evaluation.compare import compare_prediction
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import (
    joint_states, JointTopic, write_bag)

PREDICTION = '/gravity_comp/prediction'
RESIDUAL = '/gravity_comp/residual'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `replay`."""
    arguments.add_bags(parser, nargs=None)
    arguments.add_model(parser, 'model file')
    arguments.add_mcap_output(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> Answer:
    model = load_model(args.model)
    options = arguments.read_options(args)
    # The bag may contain other joints, such as a gripper.
    recording = read_bag(args.bag, replace(options, joints=options.joints or model.joints))
    samples = recording.samples.joints(model.joints)
    predicted = predict_torque(model, samples)
    comparison = compare_prediction(
        samples, predicted, model.coverage.distance(samples.q).max(axis=1) > 0.0)
    residual, outside = comparison.residual, comparison.share_outside
    topics = [joint_states(samples),
              JointTopic(PREDICTION, samples.names, samples.t, samples.q, effort=predicted),
              JointTopic(RESIDUAL, samples.names, samples.t, samples.q, effort=residual)]
    count = write_bag(args.output, topics, recording.report.start_ns)
    beyond = [f'{100 * outside:.0f} % of the samples are outside the trained range of the model']
    return Answer(
        {'output': str(args.output), 'n': len(samples),
         'joints': {joint: {'rms': error.rmse, 'max_abs': error.max_abs}
                    for joint, error in comparison.joints.items()},
         'outside_trained_range': outside, 'notes': recording.report.notes},
        [*recording.report.notes,
         TextTable(('joint', 'rms N·m', 'max N·m'),
                   [(joint, f'{error.rmse:.3f}', f'{error.max_abs:.3f}')
                    for joint, error in comparison.joints.items()], 'Residual'),
         f'wrote {args.output}: {counted(count, "message")} on /joint_states, {PREDICTION} and '
         f'{RESIDUAL}',
         'open the file in PlotJuggler or Foxglove; config/layouts has layouts for both'],
        [*scale_warnings(model, [recording.report]), *beyond * (outside > 0)])
