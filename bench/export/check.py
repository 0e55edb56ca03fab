"""
Faults of descriptions found by `check`: fourteen real arms, one drawn fault each.

    python3 -m bench.export.check [--seeds 500 501] [--arms panda ur5]

The arm moves as described (`bench.real_robots`: multisines within a box of poses, inertia, noise,
in two of three cases LuGre friction on every joint; no hidden effect). The description that is
checked has one fault: an axis reversed, an axis turned by 10 deg, a mass 30 % too large, a mount
turned by 90 deg, a zero angle off by 5 deg, or no camera of 0.4 kg on the last link. A fault is
redrawn until it changes the static torque by three noise levels (rms) on some joint, beyond offset
and friction; for each case the description without fault is checked too.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
import sys
import time
from xml.etree import ElementTree

from bench.real_robots.arms import arm_of, SOURCES, urdf
from bench.real_robots.cases import generator, Setting
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.description_check.check import check_description, DescriptionCheck
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pinocchio as pin

KINDS = ('axis_reversed', 'axis_turned', 'mass', 'mount', 'zero_angle', 'body')
# Least rms of a fault beyond offset and friction, in noise levels.
VISIBLE = 3.0


@dataclass(frozen=True)
class Outcome:
    """The result of one check: the drawn fault, and the faults that were named."""

    arm: str
    seed: int
    kind: str
    subject: str
    named: tuple[tuple[str, ...], ...]
    seconds: float

    @property
    def is_right(self) -> bool:
        """Return whether the fault is named, among the first and its alternatives."""
        own = f'{self.kind} {self.subject}'
        return any(own in names for names in self.named[:1])

    @property
    def n_false(self) -> int:
        """Return the number of faults that are named and not there."""
        own = f'{self.kind} {self.subject}'
        return sum(own not in names for names in self.named)


def with_fault(text: str, kind: str, joint: int, rng: np.random.Generator) -> tuple[str, str]:
    """Return a description with a fault, and its subject."""
    root = ElementTree.fromstring(text)
    joints, links = root.findall('joint'), root.findall('link')[1:]
    name = joints[joint].get('name')
    axis = np.array(joints[joint].find('axis').get('xyz').split(), dtype=float)
    if kind == 'axis_reversed':
        joints[joint].find('axis').set('xyz', _text(-axis))
    elif kind == 'axis_turned':
        across = np.cross(axis, rng.normal(size=3))
        turn = pin.exp3(np.deg2rad(10.0) * across / np.linalg.norm(across))
        joints[joint].find('axis').set('xyz', _text(turn @ axis))
    elif kind == 'mass':
        mass = links[joint].find('inertial/mass')
        mass.set('value', repr(1.3 * float(mass.get('value'))))
        name = links[joint].get('name')
    elif kind in ('mount', 'zero_angle'):
        origin = joints[0 if kind == 'mount' else joint].find('origin')
        rotation = pin.rpy.rpyToMatrix(np.array(origin.get('rpy').split(), dtype=float))
        if kind == 'mount':
            turn = np.deg2rad(90.0) * rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(2)]
            origin.set('xyz', _text(pin.exp3(turn) @ np.array(origin.get('xyz').split(), float)))
            rotation, name = pin.exp3(turn) @ rotation, 'base'
        else:
            rotation = rotation @ pin.exp3(np.deg2rad(5.0) * rng.choice([-1.0, 1.0]) * axis)
        origin.set('rpy', _text(pin.rpy.matrixToRpy(rotation)))
    return ElementTree.tostring(root, encoding='unicode'), name or ''


def _text(values: FloatArray) -> str:
    return ' '.join(repr(float(x)) for x in values)


def _with_camera(text: str, rng: np.random.Generator) -> str:
    """Return a description of the arm with a camera of 0.4 kg on its last link."""
    place = 0.06 * rng.normal(size=3)
    last = text.split('<joint name="')[-1].split('"')[0]
    return text.replace('</robot>', (
        f'<link name="camera"><inertial><origin xyz="{_text(place)}"/><mass value="0.4"/>'
        f'<inertia ixx="2e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="camera_mount" type="fixed"><parent link="{last}_link"/>'
        f'<child link="camera"/></joint></robot>'))


def checked(text: str, samples: JointSamples) -> DescriptionCheck:
    """Return the check of a description on a recording."""
    arm = described_arm(text, samples.names)
    return check_description(slow_samples(samples).samples, arm)


def trial(name: str, seed: int) -> list[Outcome]:
    """Return the outcomes of one case: with a fault, and without."""
    rng = generator(name, seed, 7)
    own = urdf(name)
    kind = KINDS[(seed + list(SOURCES).index(name)) % len(KINDS)]
    for _ in range(100):
        joint = int(rng.integers(len(SOURCES[name].joints)))
        true = _with_camera(own, rng) if kind == 'body' else own
        described, subject = with_fault(own, kind, joint, rng)
        if kind == 'body':
            subject = SOURCES[name].joints[-1]
        setting = Setting.drawn(arm_of(true), rng)
        motions = [setting.motion() for _ in range(2)]
        q = np.concatenate([motion.q[::25] for motion in motions])
        change = gravity_torque(setting.arm, q) - gravity_torque(arm_of(described), q)
        if (change.std(axis=0) / setting.noise).max() >= VISIBLE:
            break
    friction = setting.friction()
    runs = [setting.run(friction, motion) for motion in motions]
    samples = _joined(runs, SOURCES[name].joints)
    outcomes = []
    for text, fault, of in ((described, kind, subject), (true, 'none', '')):
        start = time.perf_counter()
        result = checked(text, samples)
        names = tuple(tuple(f'{one.fault.kind} {" ".join(one.fault.subjects)}'
                            for one in (fit, *fit.alternatives)) for fit in result.faults)
        outcomes.append(Outcome(name, seed, fault, of, names, time.perf_counter() - start))
    return outcomes


def _joined(runs: list, joints: tuple[str, ...]) -> JointSamples:
    return concatenate([JointSamples.single_run(joints, run.t, run.q, run.qd, run.tau)
                        for run in runs])


def _line(one: Outcome) -> str:
    mark = 'false' if one.n_false else 'ok'
    if one.kind != 'none':
        mark = 'named' if one.is_right else 'missed'
        mark += f', {one.n_false} false' if one.n_false else ''
    return (f'{one.arm:10} {one.seed} {one.kind} {one.subject}: {mark}  {one.named} '
            f'{one.seconds:.1f} s')


def main() -> int:
    """Run all cases and print the table."""
    parser = argparse.ArgumentParser(description='Faults of descriptions found by check.')
    parser.add_argument('--seeds', type=int, nargs='+', default=[500])
    parser.add_argument('--arms', nargs='+', default=list(SOURCES))
    parser.add_argument('--workers', type=int, default=1)
    args = parser.parse_args()
    cases = [(name, seed) for seed in args.seeds for name in args.arms]
    outcomes = []
    with ProcessPoolExecutor(args.workers) as pool:
        for both in pool.map(trial, *zip(*cases)):
            outcomes += both
            print(*map(_line, both), sep='\n', flush=True)
    faulty = [one for one in outcomes if one.kind != 'none']
    clean = [one for one in outcomes if one.kind == 'none']
    for kind in KINDS:
        of_kind = [one for one in faulty if one.kind == kind]
        print(f'{kind:14} {sum(one.is_right for one in of_kind)} of {len(of_kind)} named')
    print(f'all            {sum(one.is_right for one in faulty)} of {len(faulty)} named, '
          f'{sum(one.n_false for one in faulty)} false faults in addition')
    print(f'without fault  {sum(one.n_false > 0 for one in clean)} of {len(clean)} descriptions '
          f'with a false fault')
    return 0


if __name__ == '__main__':
    sys.exit(main())
