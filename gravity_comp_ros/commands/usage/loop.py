"""Arguments of the verbs of the loop: fit, compare, diagnose, add, update, plan, replay."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments


@arguments.verb('learn the gravity model of an arm from slow motion', """\
examples:
  gravity_comp fit run1.mcap run2.mcap -o arm.json
  gravity_comp fit run1.mcap --holdout -o arm.json      report the held-out error
  gravity_comp fit run1.db3 --joints a1,a2,a3 --effort-scale a1=-1,a2=-1,a3=-1 -o arm.json
  gravity_comp fit run1.mcap --effects coulomb_friction,torque_offset:wrist -o arm.json
  gravity_comp fit run1.mcap --formulation per_joint --json report.json -o paper.json
  gravity_comp fit run1.mcap --urdf robot.urdf -o arm.json   chain with known axes

which recordings: slow motion (every joint under 0.15 rad/s) through the poses of the task, every
joint in both directions, with a constant payload; a minute or more, two runs rather than one.

Gravity is fitted jointly with friction, inertia and other effects, to slow samples, or to all if
fewer than 100 of at least 200, or less than a fifth, are slow. With --holdout the saved model is
fitted without the held-out data; `compare --holdout` uses that data.
""", arguments.add_bags, arguments.add_gate, arguments.add_reading, arguments.add_json)
def fit(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fit`."""
    parser.add_argument('-o', '--output', metavar='MODEL.json', type=Path,
                        help='model file to write (without it, the fit is only shown)')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS,
                        help='potential: one potential energy for all joints; chain: potential '
                        'energy of a serial arm; auto: the chain if its residual is white or '
                        'small, else the one of these two with the smaller held-out error; '
                        'per_joint: each joint separately, as in Yu 2022 '
                        '(default: auto; chain with --urdf)')
    parser.add_argument('--holdout', metavar='SHARE', type=arguments.positive, nargs='?',
                        const=0.2, help='share of the data held out of the fit '
                        'for the error: whole runs, or blocks of a single run (0.2 if no number '
                        'is given)')
    parser.add_argument('--effects', metavar='A,B:JOINT,...',
                        help='effects fitted jointly with gravity; without a joint, on every '
                        'joint where they are identifiable (docs/effects.md lists all)')
    arguments.add_urdf(parser, 'joint axes of the chain')


@arguments.verb('compare the torque of a model with measured torque, for each joint', """\
examples:
  gravity_comp compare run2.mcap --model arm.json
  gravity_comp compare run1.mcap --model arm.json --holdout      only the held-out part of run1
  gravity_comp compare fast.mcap --model arm.json --all-samples --json errors.json
  gravity_comp compare run2.mcap --model arm.json --html report.html      report with plots

which recordings: recordings that were not fitted, with the payload of the model. Errors on fitted
recordings are too small. For a held-out error use `fit --holdout`, then --holdout here.

RMSE, std and max are of the residual, measured minus predicted torque. nRMSE is RMSE over the
range of the measured torque (Yu 2022, Eq. 16); it is meaningless for joints without gravity load.
"in band" is the share of residuals inside the 95 % prediction band within the trained range;
"outside" is the same share for poses outside the trained range. A share near 95 % confirms the
band. A share far below 95 % indicates a changed payload or a missing effect. A share of 100 %
means that the band is too wide, often where few samples were trained. "training" is the RMSE of
the fit, "constant" that of a constant torque.
""", arguments.add_bags, arguments.add_gate, arguments.add_reading, arguments.add_json,
                arguments.add_page)
def compare(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    arguments.add_model(parser, 'model file, written by `fit`')
    parser.add_argument('--holdout', action='store_true',
                        help='of the fitted bags, use only the data that `fit --holdout` '
                        'held out')
    arguments.add_description(parser, arguments.DRAWN, fixed=False)
    parser.add_argument('--previous', metavar='MODEL.json', type=Path,
                        help='earlier model of this arm: what drifted since then; the --html '
                        'report also lists its errors (default there: before the last addition)')


@arguments.verb('identify physical effects missing from a gravity model, with their size', """\
examples:
  gravity_comp diagnose run1.mcap run2.mcap --model arm.json
  gravity_comp diagnose run1.mcap                         without a model file
  gravity_comp diagnose run1.mcap --effects coulomb_friction,viscous_friction --json
  gravity_comp diagnose run1.mcap --model arm.json --html report.html    report with plots

which recordings: the fitted recordings and any others of the same arm with the same payload, slow
or fast. More runs resolve more findings; errors are always held-out errors.

verdicts:
  established   strong evidence without an alternative, and a smaller held-out error: add it
  likely        the same with less evidence: add it
  ambiguous     another effect explains the data equally well; both are listed, with the motion
                that distinguishes them. Add both: their sum is predicted, not their split
  weak          hardly reduces the held-out error, or its size is not physical or not different
                from 0: do not add
  untestable    not identifiable with this motion: do not add
  unexplained   a repeating residual that no known effect describes
The effects were selected jointly: add all of them with the printed command.

All samples are used, including fast ones, because inertia is one of the effects. Errors are
held-out errors relative to the range of the measured torque (Yu 2022, Eq. 16).
""", arguments.add_bags, arguments.add_reading, arguments.add_json, arguments.add_page)
def diagnose(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `diagnose`."""
    arguments.add_model(parser, 'model file, written by `fit` (default: a model is fitted)',
                        required=False)
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list,
                        help='test these effects only (default: all known effects)')
    arguments.add_description(parser, f'{arguments.DRAWN}; without --model, also the joint axes',
                              fixed=False)


@arguments.verb('add effects to a model, refit it, and compare held-out errors', """\
examples:
  gravity_comp add coulomb_friction:elbow --model arm.json run1.mcap run2.mcap
  gravity_comp add coulomb_friction,viscous_friction --model arm.json run1.mcap
                                       on every joint where they are identifiable
  gravity_comp add torque_offset:wrist --model arm.json run1.mcap --dry-run
  gravity_comp add --undo --model arm.json

Gravity and effects are fitted jointly, to the samples that pass the gate of `fit` unless another
is named, without the data that `fit --holdout` held out. Errors are held-out errors, of whole runs
or of blocks of time. If another effect
explains the recordings equally well, `add` lists it. docs/effects.md describes every effect.
""", arguments.add_json)
def add(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `add`."""
    parser.add_argument('effects', metavar='EFFECT[:JOINT]', nargs='?',
                        help='effects to add, separated by commas; without a joint, on every '
                        'joint where the effect is identifiable')
    arguments.add_bags(parser, nargs='*')
    arguments.add_model(parser, 'model file to change')
    parser.add_argument('--undo', action='store_true',
                        help='remove the last addition; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show the result, write nothing')
    arguments.add_gate(parser, 'fitted samples (default: those of the gate of `fit`)')
    arguments.add_reading(parser, joints=False)
    parser.set_defaults(output=None, rewrites_model=True)


@arguments.verb('update a model after a payload change, from ten seconds of slow motion', """\
examples:
  gravity_comp update tool.mcap --model arm.json -o with_tool.json
  gravity_comp update tool.mcap --model arm.json --urdf robot.urdf -o with_tool.json
                                       also mass and centre of mass of the tool
  gravity_comp update tool.mcap --model arm.json        changes arm.json in place
  gravity_comp update --undo --model arm.json           restores it

which recordings: at least ten seconds of slow motion that rotates every joint by tens of degrees,
recorded with the new payload only. The model must be a chain or a potential; a chain
(`fit --formulation chain`) requires far fewer samples. With --urdf the new model is always a
chain. Effects of the model are kept unchanged.
""", arguments.add_gate, arguments.add_json)
def update(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `update`."""
    arguments.add_bags(parser, nargs='*')
    arguments.add_model(parser, 'model of the arm before the payload change')
    parser.add_argument('-o', '--output', metavar='NEW.json', type=Path,
                        help='model file to write (default: replaces the old model, which '
                        '--undo restores)')
    parser.add_argument('--undo', action='store_true',
                        help='undo the last update of the model; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show the result, write nothing')
    arguments.add_urdf(parser, 'joint axes, for the mass and centre of mass of the payload')
    parser.add_argument('--flange', metavar='LINK',
                        help='link of --urdf in whose frame the centre of mass is given, such as '
                        'tool0 (default: the link of the last joint)')
    arguments.add_reading(parser, joints=False)
    parser.set_defaults(rewrites_model=True)


# Copies from `planning.trajectory_files` and `planning.PlanOptions`, so that --help does not
# import them; a test compares both.
ENDINGS = ('.yaml', '.yml', '.mcap')
LIMITS = (('duration', 'S', 20.0, 'maximum duration'),
          ('max_speed', 'RAD/S', 0.3, 'of every joint'),
          ('max_acceleration', 'RAD/S²', 1.0, 'of every joint'),
          ('max_jerk', 'RAD/S³', 10.0, 'of every joint'))


@arguments.verb('plan the motion that resolves open findings', """\
examples:
  gravity_comp plan run1.mcap --model arm.json -o motion.yaml
  gravity_comp plan run1.mcap --model arm.json --settle coulomb_friction:elbow -o motion.yaml
  gravity_comp plan run1.mcap --model arm.json --widen 0.7 --urdf robot.urdf -o motion.yaml
  ros2 topic pub --once /joint_trajectory_controller/joint_trajectory \\
      trajectory_msgs/msg/JointTrajectory "$(cat motion.yaml)"
  gravity_comp synth --motion motion.yaml -o new.mcap              simulate it
  gravity_comp diagnose run1.mcap new.mcap --model arm.json        the result

The motion begins and ends at rest at one recorded pose. It stays near recorded poses and moves one
or two joints at a time, or all joints if more have targets. Move the arm to the first point
before playing it. Obstacles and people are not checked: keep the space clear. With a description
and pinocchio, self-collisions of the arm are checked.
""", arguments.add_bags, arguments.add_json)
def plan(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    arguments.add_model(parser, 'gravity model of the arm (chain or potential)')
    parser.add_argument('-o', '--output', metavar='MOTION', type=arguments.file_type(*ENDINGS),
                        required=True,
                        help=f'motion file to write ({", ".join(ENDINGS)})')
    parser.add_argument('--settle', metavar='EFFECT:JOINT,...',
                        help='effects to resolve; `gravity` for poses with a large uncertainty '
                        'of the model (default: effects that `diagnose` reports as ambiguous, '
                        'untestable or weak, and gravity where it is uncertain)')
    group = parser.add_argument_group('limits')
    arguments.add_description(group, 'robot description: position limits and collision geometry '
                              '(default: /robot_description in the recordings)', fixed=False)
    group.add_argument('--widen', metavar='RAD', type=arguments.positive,
                       help='extend the recorded range of every joint by this angle, in any pose '
                       'of the others, within the limits of the description if there is one; 7 '
                       'allows all of these limits; check that the arm has the space (default: '
                       'within 0.3 rad of recorded poses)')
    for name, unit, default, what in LIMITS:
        group.add_argument('--' + name.replace('_', '-'), metavar=unit, type=arguments.positive,
                           default=default, help=f'{what} (default: %(default)s)')
    group.add_argument('--start', metavar='RAD,...', type=arguments.numbers,
                       help='start and end pose, one value for each joint of the model '
                       '(default: a recorded pose near the middle)')
    group = parser.add_argument_group('output')
    group.add_argument('--goal', action='store_true',
                       help='write YAML as the goal of a FollowJointTrajectory action')
    group.add_argument('--effort', action='store_true',
                       help="add the model's gravity torque as effort")
    arguments.add_reading(parser, joints=False)


@arguments.verb('write measured, predicted and residual torque to an MCAP file for PlotJuggler '
                'or Foxglove', """\
topics of the output, all sensor_msgs/JointState:
  /joint_states              effort = measured torque, N·m
  /gravity_comp/prediction   effort = torque of the model, gravity and effects, N·m
  /gravity_comp/residual     effort = measured minus predicted torque, N·m

examples:
  gravity_comp replay run2.mcap --model arm.json -o out.mcap
""", arguments.add_mcap_output, arguments.add_reading, arguments.add_json)
def replay(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `replay`."""
    arguments.add_bags(parser, nargs=None)
    arguments.add_model(parser, 'model file')
