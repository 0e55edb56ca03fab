"""
Record a simulated arm with motion, payload, hidden effects and noise.

motions:
  eq15       seven joints, up to 3.1 rad/s: the test motion of Yu 2022 (20 s at 10 Hz)
  eq17       seven joints, up to 0.11 rad/s: its slow training motion (100 s at 5 Hz)
  random     poses at rest, uniform within the joint limits, 2 s apart (1000 poses)
  FILE.yaml  a motion written by `gravity_comp plan` (50 Hz)
  multisine  seeded sums of sines within the limits, for any arm (100 s at 50 Hz)

For example:
  gravity_comp synth --motion eq17 --noise 0.1 -o slow.mcap
  gravity_comp synth --motion eq17 --start 100 --noise 0.1 --seed 1 -o later.mcap
  gravity_comp synth --motion eq17 --payload 2 --payload-at 50 -o loaded.mcap
  gravity_comp synth --motion multisine --hidden coulomb_friction:4=0.8 -o rough.mcap
  gravity_comp synth --motion random --samples 1000 --relative-noise 0.01 -o poses.mcap
  gravity_comp synth --arm robot.urdf --motion multisine --max-speed 0.1 -o robot.mcap

hidden effects and their SIZE, in the units of `diagnose` (JOINT is a name or a number from 1; the
default SIZE exceeds the noise of a typical arm):
"""

from __future__ import annotations

import argparse
from math import radians
from pathlib import Path

from gravity_comp_ros.commands import arguments, next_step
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.planning.trajectory_files import read_trajectory
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.hidden import Hidden, hidden, size_table
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np

_FILE_RATE = 50.0
# Length in s and rate in Hz.
_DEFAULTS = {'eq15': (20.0, 10.0), 'eq17': (100.0, 5.0), 'random': (2000.0, 0.5),
             'multisine': (100.0, 50.0)}
_MAX_SAMPLES = 1e6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `synth`."""
    parser.epilog = f'{parser.epilog}{size_table()}\n'
    arguments.add_recording_output(parser)
    parser.add_argument('--seed', type=int, default=0,
                        help='seed of random motion and noise (default: 0)')
    group = parser.add_argument_group('arm')
    group.add_argument('--arm', metavar='iiwa7|FILE.urdf', default='iiwa7',
                       type=arguments.file_type(names=('iiwa7',)),
                       help='KUKA LBR iiwa 7 R800, or any arm of revolute joints')
    group.add_argument('--tilt', metavar=('ROLL', 'PITCH'), nargs=2, type=arguments.number(
        float, 'within -180 to 180 degrees', lambda value: abs(value) <= 180.0),
                       default=(0.0, 0.0),
                       help='tilt of the base, -180 to 180 degrees (default: level)')
    group.add_argument('--joint-names', metavar='A,B,...', type=arguments.joint_list,
                       help='joint names in the output (default: those of the arm)')
    group = parser.add_argument_group('motion')
    group.add_argument('--motion', metavar='NAME|FILE', default='eq17',
                       type=arguments.file_type('.yaml', '.yml', names=_DEFAULTS),
                       help=f'{", ".join(_DEFAULTS)} (see below), or a motion written by `plan` '
                       '(.yaml) (default: eq17)')
    group.add_argument('--duration', metavar='S', type=arguments.positive, help='length in s')
    group.add_argument('--rate', metavar='HZ', type=arguments.positive, help='samples per second')
    group.add_argument('--samples', metavar='N', type=arguments.count,
                       help='number of samples, instead of a duration')
    group.add_argument('--start', metavar='S', type=arguments.finite, default=0.0,
                       help='start time within the motion (default: 0)')
    group.add_argument('--max-speed', metavar='RAD/S', type=arguments.positive,
                       help='maximum speed of every joint in a multisine (default: 0.1)')
    group = parser.add_argument_group('torque')
    group.add_argument('--payload', metavar='KG', type=arguments.positive,
                       help='mass on the last link')
    group.add_argument('--payload-com', metavar=('X', 'Y', 'Z'), nargs=3, type=arguments.finite,
                       help="its centre of mass in the last joint's frame, in m "
                       '(default: 0 0 0.1)')
    group.add_argument('--payload-at', metavar='S', type=arguments.finite,
                       help='time from the start until it is attached (default: 0)')
    group.add_argument('--hidden', metavar='EFFECT:JOINT[=SIZE]', action='append', default=[],
                       help='unmodelled effect, simulated with other formulas than those of '
                       'the diagnosis; may be repeated (effects and units: see below)')
    group.add_argument('--noise', metavar='NM', type=arguments.finite, default=0.0,
                       help='standard deviation of the torque noise, N·m (default: 0)')
    group.add_argument('--relative-noise', metavar='FRACTION', type=arguments.finite, default=0.0,
                       help='the same as a fraction of the torque (default: 0)')
    group.add_argument('--static', action='store_true',
                       help='gravity torque only, as if the arm stopped for every sample')


def run(args: argparse.Namespace) -> Answer:
    arm = _arm(args)
    motion = _motion(args, arm)
    hidden_effects = [hidden(text, arm) for text in args.hidden]
    samples = synthesise(arm, motion, _synthesis(args, hidden_effects))
    origin = {'arm': arm.name, 'command': args.command,
              'hidden': [effect.to_json() for effect in hidden_effects]}
    write_bag(args.output, [joint_states(samples, args.topic)],
              metadata={'gravity_comp_synth': origin})
    notes, duration = _limit_violations(arm, samples), samples.t[-1] - samples.t[0]
    payload = f' with {args.payload:g} kg' if args.payload else ''
    return Answer(
        {'output': str(args.output), 'joints': samples.names, 'n_samples': len(samples),
         'duration_s': duration, 'motion': str(args.motion), 'seed': args.seed,
         'payload_kg': args.payload, 'hidden': args.hidden, 'notes': notes,
         'hidden_sizes': origin['hidden']},
        [f'wrote {args.output}: {arm.name}{payload}, motion {motion.name}, '
         f'{counted(len(samples), "sample")} of {counted(samples.n_joints, "joint")}, '
         f'{duration:.4g} s', *(f'hidden: {effect}' for effect in hidden_effects),
         *next_step.check_recordings(args.output)], notes)


def _arm(args: argparse.Namespace) -> arms.Arm:
    arm = arms.iiwa7() if args.arm == 'iiwa7' else arms.from_urdf(args.arm)
    roll, pitch = args.tilt
    if roll or pitch:
        arm = arms.with_base_tilt(arm, radians(roll), radians(pitch))
    return arm if args.joint_names is None else arms.renamed(arm, args.joint_names)


def _motion(args: argparse.Namespace, arm: arms.Arm) -> motions.Motion:
    if args.samples is not None and args.duration is not None:
        raise OptionError('give --samples or --duration, not both')
    trajectory = _trajectory(args, arm) if isinstance(args.motion, Path) else None
    if trajectory is None and args.max_speed is not None and args.motion != 'multisine':
        raise OptionError(f'--max-speed applies to multisine only, not to {args.motion}')
    duration, rate = _DEFAULTS[args.motion] if trajectory is None else (
        trajectory.duration, _FILE_RATE)
    rate = args.rate or rate
    duration = args.samples / rate if args.samples else args.duration or duration
    if duration * rate > _MAX_SAMPLES:
        raise OptionError(f'{duration:g} s at {rate:g} Hz are {duration * rate:.3g} samples; the '
                          f'maximum is {_MAX_SAMPLES:.0e}: shorten --duration or lower --rate')
    if trajectory is not None:
        return motions.sample(args.motion.name, trajectory.at, duration, rate)
    if args.motion == 'random':
        poses = max(1, round(duration * rate))
        return motions.random_poses(arm.lower, arm.upper, poses, args.seed, 1 / rate, args.start)
    if args.motion == 'multisine':
        options = motions.MultisineOptions(max_speed=args.max_speed or 0.1)
        return motions.multisine(arm.lower, arm.upper, arm.max_speed, args.seed, options,
                                 duration, rate, args.start)
    make = motions.eq15 if args.motion == 'eq15' else motions.eq17
    return make(duration, rate, args.start)


def _trajectory(args: argparse.Namespace, arm: arms.Arm) -> Trajectory:
    """Return the motion of a trajectory file, with the joints in the order of the arm."""
    if args.max_speed is not None or args.start:
        raise OptionError('--max-speed and --start do not apply to a motion from a file')
    trajectory = read_trajectory(args.motion)
    if sorted(trajectory.joints) != sorted(arm.joints):
        raise OptionError(f'{args.motion} moves {", ".join(trajectory.joints)}, but the joints of '
                          f'{arm.name} are {", ".join(arm.joints)}')
    order = [trajectory.joints.index(joint) for joint in arm.joints]
    return Trajectory(arm.joints, trajectory.t - trajectory.t[0], *(
        values[:, order] for values in (trajectory.q, trajectory.qd, trajectory.qdd)))


def _synthesis(args: argparse.Namespace, hidden_effects: list[Hidden]) -> SynthesisOptions:
    if args.hidden and args.static:
        raise OptionError('--hidden requires a moving arm: omit --static')
    payload = None
    if args.payload is not None:
        com = tuple(args.payload_com or (0.0, 0.0, 0.1))
        payload = arms.Payload(args.payload, com)
    elif args.payload_com is not None:
        raise OptionError('--payload-com requires --payload')
    noise = NoiseOptions(args.relative_noise, args.noise)
    at = None if args.payload_at is None else args.start + args.payload_at
    disturbances = tuple(effect.disturbance for effect in hidden_effects)
    return SynthesisOptions(noise, args.seed, args.static, payload, at, disturbances)


def _limit_violations(arm: arms.Arm, samples: JointSamples) -> list[str]:
    over = np.maximum(samples.q.max(axis=0) - arm.upper, arm.lower - samples.q.min(axis=0))
    return [f'joint {joint} exceeds its limit by {excess:.3f} rad'
            for joint, excess in zip(arm.joints, over) if excess > 1e-9]
