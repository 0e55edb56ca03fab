"""
Faults of descriptions found by `check`: fourteen real arms, one drawn fault each.

    python3 -m bench.export.check [--seeds 500-501] [--arms panda,ur5]

The arm moves as described (`bench.real_robots`: multisines within a box of poses, inertia, noise,
in two of three cases LuGre friction on every joint; no hidden effect). The description that is
checked has one fault: an axis reversed, an axis turned by 10 deg, a mass 30 % too large, a mount
turned by 90 deg, a zero angle off by 5 deg, or no camera of 0.4 kg on the last link. A fault is
redrawn until it changes the static torque by three noise levels (rms) on some joint, beyond offset
and friction; for each case the description without fault is checked too.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Sequence
import sys
import time
from xml.etree import ElementTree

from bench.real_robots.arms import arm_of, SOURCES, urdf
from bench.real_robots.cases import generator, Setting
from bench.real_robots.run import arms_and_seeds, each
from bench.shared.runner import Result, run
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.description_check.check import check_description
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pinocchio as pin

KINDS = ('axis_reversed', 'axis_turned', 'mass', 'mount', 'zero_angle', 'body')
# Least rms of a fault beyond offset and friction, in noise levels.
VISIBLE = 3.0


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


def trial(name: str, seed: int) -> Result:
    """Return the faults that are named in one case, with a fault and without, by subjects."""
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
    samples = slow_samples(concatenate([
        JointSamples.single_run(SOURCES[name].joints, one.t, one.q, one.qd, one.tau)
        for one in (setting.run(friction, motion) for motion in motions)])).samples
    result: Result = {'fault': f'{kind} {subject}', 'kind': kind}
    for key, text in (('named', described), ('without', true)):
        start = time.perf_counter()
        found = check_description(samples, described_arm(text, samples.names))
        result[key] = [[f'{one.fault.kind} {" ".join(one.fault.subjects)}'
                        for one in (fit, *fit.alternatives)] for fit in found.faults]
        result[f'{key} seconds'] = time.perf_counter() - start
    result['right'] = result['fault'] in next(iter(result['named']), [])
    result['false'] = sum(result['fault'] not in names for names in result['named'])
    return result


def options(parser: ArgumentParser) -> None:
    arms_and_seeds(parser)
    parser.set_defaults(seeds=[500])


def line(one: Result) -> str:
    return (f'{one["fault"]}: {"named" if one["right"] else "missed"}, {one["false"]} false '
            f'{one["named"]} {one["named seconds"]:.1f} s; without fault {one["without"]} '
            f'{one["without seconds"]:.1f} s')


def totals(results: Sequence[Result]) -> str:
    def named(title: str, group: Sequence[Result]) -> str:
        return f'{title:14} {sum(one["right"] for one in group)} of {len(group)} named'

    return '\n'.join([
        *(named(kind, [one for one in results if one['kind'] == kind]) for kind in KINDS),
        f'{named("all", results)}, {sum(one["false"] for one in results)} false faults added',
        f'without fault  {sum(bool(one["without"]) for one in results)} of {len(results)} '
        f'descriptions with a false fault'])


if __name__ == '__main__':
    sys.exit(run(__doc__, options, each, trial, line, totals))
