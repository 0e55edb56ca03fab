"""`check`: each fault of a description is found, named, and its correction corrects it."""

from dataclasses import replace
from html import escape
import json
from pathlib import Path
import re
from xml.etree import ElementTree

from bench.shared.campaign import campaign
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm, frame_parameters
from gravity_comp_ros.description_check.check import check_description
from gravity_comp_ros.description_check.faults import FaultyArm
from gravity_comp_ros.description_check.sentences import findings
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.kinematic.chain import tilt
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
import numpy as np
import pinocchio as pin
import pytest

BAGS = Path(__file__).resolve().parents[3] / 'bags'
URDF = (BAGS / 'iiwa7.urdf').read_text()
# The wrist is held at 0: the number of faults that are compared is quadratic in that of joints.
JOINTS = tuple(f'iiwa_joint_{n}' for n in range(1, 6))


@pytest.fixture(scope='module')
def samples():
    """Return random poses with 0.1 N·m of noise."""
    arm, rng = iiwa7(), np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (84, 7))
    q[:, 5:] = 0.0
    tau = gravity_torque(arm, q) + 0.1 * rng.standard_normal(q.shape)
    return JointSamples.single_run(JOINTS, 2.0 * np.arange(84), q[:, :5], 0.0 * q[:, :5],
                                   tau[:, :5])


def edited(joint=None, link=None, **changes):
    """Return the description with attributes changed: tag_attribute=value."""
    root = ElementTree.fromstring(URDF)
    where = root.find(f'joint[@name="{joint}"]') if joint else root.find(
        f'link[@name="{link}"]/inertial')
    for key, value in changes.items():
        tag, attribute = key.split('_')
        where.find(tag).set(attribute, value)
    return ElementTree.tostring(root, encoding='unicode')


def checked(text, samples, *scales):
    arm = described_arm(text, JOINTS)
    result = check_description(samples, arm)
    return result, findings(result, arm, *scales)


def rpy_of(joint, turn=None, about=None):
    """Return the rpy of a joint with its frame turned by `turn`, or the parent's by `about`."""
    origin = ElementTree.fromstring(URDF).find(f'joint[@name="{joint}"]/origin')
    rotation = pin.rpy.rpyToMatrix(np.array(origin.get('rpy').split(), float))
    rotation = rotation @ turn if turn is not None else about @ rotation
    return ' '.join(repr(float(x)) for x in pin.rpy.matrixToRpy(rotation))


def turned(degrees, axis):
    return pin.exp3(np.deg2rad(degrees) * np.array(axis, float))


CASES = {
    'axis_turned': (lambda: edited('iiwa_joint_4', axis_xyz=' '.join(
        map(repr, (turned(10, [1, 0, 0])[:, 2]).tolist()))), 'iiwa_joint_4', 10.0),
    'zero_angle': (lambda: edited('iiwa_joint_2', origin_rpy=rpy_of(
        'iiwa_joint_2', turn=turned(5, [0, 0, 1]))), 'iiwa_joint_2', -5.0),
    'mount': (lambda: edited('iiwa_joint_1', origin_rpy=rpy_of(
        'iiwa_joint_1', about=turned(90, [1, 0, 0]))), 'base', 90.0),
    'mass': (lambda: edited(link='iiwa_link_4', mass_value='4.52686'), 'iiwa_link_4', 3.4822)}

REVERSED = edited('iiwa_joint_4', axis_xyz='0 0 -1')


@pytest.fixture(scope='module')
def faulty(samples):
    """Return the findings of each case, by kind; each check takes seconds."""
    return {kind: checked(make(), samples)[1] for kind, (make, _, _) in CASES.items()}


@pytest.mark.parametrize('kind', CASES)
def test_each_fault_is_named_with_its_size(kind, faulty):
    _, subject, value = CASES[kind]
    faults = faulty[kind]
    first = faults[0]
    assert first.kind == kind and first.subjects == (subject,) and len(faults) == 1
    low, high = first.ci95
    assert first.value == pytest.approx(value, rel=0.05)
    assert low - 0.01 * abs(value) < value < high + 0.01 * abs(value)


@pytest.mark.parametrize('kind', ['axis_turned', 'zero_angle', 'mass'])
def test_the_correction_restores_the_description(kind, faulty):
    text, first = CASES[kind][0](), faulty[kind][0]
    tag, attribute, value = re.search(r': <(\w+) (\w+)="(.*?)"/>', first.correction).groups()
    root = ElementTree.fromstring(text)
    name = re.search(r'name="(.*?)"', first.correction)[1]
    where = root.find(f'link[@name="{name}"]/inertial') if kind == 'mass' else root.find(
        f'joint[@name="{name}"]')
    where.find(tag).set(attribute, value)
    arms = [described_arm(description, JOINTS)
            for description in (ElementTree.tostring(root, encoding='unicode'), URDF)]
    masses = [[one.mass for one in arm.inertials().values()] for arm in arms]
    np.testing.assert_allclose(*(arm.geometry.rotations for arm in arms), atol=0.01)
    np.testing.assert_allclose(*masses, rtol=0.02)


def test_faults_of_the_recording(samples):
    swapped = samples.q[:, [0, 3, 2, 1, 4]], samples.tau[:, [0, 3, 2, 1, 4]]
    _, faults = checked(URDF, replace(samples, q=swapped[0], tau=swapped[1]))
    assert faults[0].kind == 'order'
    assert set(faults[0].subjects) == {'iiwa_joint_2', 'iiwa_joint_4'}
    assert faults[0].correction.startswith('--rename iiwa_joint_2=iiwa_joint_4')
    gain = np.array([1, 1, 1, -0.8, 1])
    _, faults = checked(URDF, replace(samples, tau=samples.tau * gain),
                        {'iiwa_joint_1': 3.0, 'iiwa_joint_4': 2.0})
    assert faults[0].kind == 'effort_scale' and faults[0].value == pytest.approx(-0.8, abs=0.01)
    # Of a recording that was read with scales: each is kept, or divided by the gain.
    assert faults[0].correction.startswith('--effort-scale iiwa_joint_1=3,iiwa_joint_4=-2.')


@pytest.mark.parametrize('factor', [10.2, *campaign(0.5, 100.0)])
def test_another_unit_of_every_effort(factor, samples):
    _, (fault,) = checked(URDF, replace(samples, tau=factor * samples.tau))
    assert fault.kind == 'effort_unit' and not fault.alternatives
    assert fault.value == pytest.approx(factor, rel=0.02)


def test_the_gravity_of_a_state_agrees_with_the_columns_of_links(samples):
    arm = described_arm(URDF, JOINTS)
    inertials = arm.inertials()
    x = np.concatenate([one.about_origin()[:4] for one in inertials.values()])
    bodies = frame_parameters(arm, inertials)[:, :4]
    state = FaultyArm.described(arm.geometry.rotations, arm.geometry.origins, bodies)
    expected = arm.columns(samples.q, list(inertials)) @ x
    np.testing.assert_allclose(state.gravity(samples.q), expected, atol=1e-9)
    # Turned at angle 0, an axis moves nothing.
    rest = np.zeros((1, 5))
    moved = state.turned_axis(3, tilt(np.array([[0.2, -0.1]]))[0])
    others = [0, 1, 2, 4]
    np.testing.assert_allclose(moved.gravity(rest)[:, others], state.gravity(rest)[:, others],
                               atol=1e-9)


def test_few_samples_and_descriptions_without_mass_are_refused(samples):
    arm = described_arm(URDF, JOINTS)
    with pytest.raises(DataError, match='too few'):
        check_description(samples.select(np.arange(20)), arm)
    text = re.sub(r'<inertial>.*?</inertial>', '', URDF, flags=re.DOTALL)
    with pytest.raises(DataError, match='gives no mass'):
        described_arm(text, JOINTS).inertials()
    text = re.sub(r'(<inertial>.*?<origin xyz=")[^"]*', r'\g<1>0 0 120', URDF, flags=re.DOTALL)
    with pytest.raises(DataError, match='is 120 m from the frame before it: is the descr.* mm'):
        described_arm(text, JOINTS).inertials()


def test_a_description_without_fault(samples, tmp_path, capsys):
    bag = str(tmp_path / 'poses.mcap')
    write_bag(bag, [joint_states(samples)])
    assert main(['check', bag, '--urdf', str(BAGS / 'iiwa7.urdf'), '--json',
                 str(tmp_path / 'r.json')]) == 0
    assert 'no fault found' in capsys.readouterr().out
    # Neither gravity nor a level base shows the zero of the first joint.
    (zeros,) = (line for line in json.loads((tmp_path / 'r.json').read_text())['unchecked']
                if 'zero' in line)
    assert 'iiwa_joint_1' in zeros and 'iiwa_joint_4' not in zeros


def test_the_residual_of_a_large_fault_does_not_hide_a_small_one(tmp_path, capsys):
    bag = str(tmp_path / 'camera.mcap')
    assert main(['synth', '--motion', 'multisine', '--duration', '90', '--rate', '2.5', '--noise',
                 '0.1', '--payload', '0.4', '--seed', '3', '-o', bag]) == 0
    (tmp_path / 'arm.urdf').write_text(REVERSED)
    assert main(['check', bag, '--urdf', str(tmp_path / 'arm.urdf'), '--json',
                 str(tmp_path / 'r.json'), '--html', str(tmp_path / 'r.html')]) == 3
    out = capsys.readouterr().out
    assert '1. the axis of iiwa_joint_4 is reversed' in out and '<axis xyz="0 0 1"/>' in out
    result = json.loads((tmp_path / 'r.json').read_text())
    axis, body = result['faults']
    assert (axis['kind'], body['kind']) == ('axis_reversed', 'body')
    assert axis['value'] is None and body['value'] == pytest.approx(0.4, abs=0.05)
    assert result['joints']['iiwa_joint_2']['rmse'] > 2 * result['joints']['iiwa_joint_2'][
        'rmse_corrected']
    page = (tmp_path / 'r.html').read_text()
    assert all(escape(one['sentence']) in page for one in result['faults'])
    assert 'arm.urdf: 2 faults found' in page and 'data-copy="&lt;joint' in page
    # Sentences and tables need no script.
    assert 'noscript' not in page
