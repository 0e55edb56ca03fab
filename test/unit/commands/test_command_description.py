"""`fit` and `update` with the robot description of a recording."""

import json

from bench.shared import urdf_snippets as robots
from bench.shared.waisted_arm import IIWA, JOINTS, recording, WAIST, WAISTED
from gravity_comp_ros.cli import main
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.simulation import arms, motions
import pytest


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Return bags of the iiwa: alone, of another description, and on a waist with a gripper."""
    folder = tmp_path_factory.mktemp('described')
    q, arm = motions.eq17(duration=40.0).q, arms.iiwa7()
    backwards = tuple(reversed(JOINTS))
    recording(folder / 'own', IIWA, arm, q, order=lambda names: backwards)
    recording(folder / 'other', robots.UR, arm, q)
    # A waist that leans forward about y rotates the vertical in the opposite direction.
    leaning = arms.with_base_tilt(arm, 0.0, WAIST)
    finger = ('finger', lambda n: 0.01 * (n % 2))
    recording(folder / 'leaning', WAISTED, leaning, q, 0, [finger, ('waist', lambda n: WAIST)])
    recording(folder / 'moving', WAISTED, leaning, q, 0, [finger, ('waist', lambda n: 1e-3 * n)])
    recording(folder / 'lacking', WAISTED, leaning, q, 0, [finger])
    loaded = arms.with_payload(arm, arms.Payload(2.0, (0.0, 0.0, 0.1)))
    recording(folder / 'tool', IIWA, loaded, motions.eq17(start=100.0, duration=10.0).q, 1)
    return folder


def run(capsys, *argv):
    capsys.readouterr()
    status = main([*map(str, argv)])
    out = capsys.readouterr()
    assert status == 0, out.err
    return json.loads(out.out), out.err


def test_the_recordings_own_description_is_used(bags, tmp_path, capsys):
    model = tmp_path / 'arm.json'
    result, errors = run(capsys, 'fit', bags / 'own', '-o', model, '--json')
    assert result['description'] == {
        'source': '/robot_description in own', 'joints': list(JOINTS), 'link': 'iiwa_link_7',
        'left_out': [], 'held': {}}
    assert result['joint_order'] == 'description' and errors.count('warning') == 0
    assert load_model(model).joints == JOINTS
    assert load_model(model).provenance['description']['source'] == '/robot_description in own'
    assert result['report']['known_axes']
    # The payload is estimated without a file argument.
    payload, _ = run(capsys, 'update', bags / 'tool', '--model', model, '--dry-run', '--json')
    assert payload['description']['source'] == '/robot_description in tool'
    assert payload['payload']['mass']['value'] == pytest.approx(2.0, rel=0.03)
    bare, _ = run(capsys, 'update', bags / 'tool', '--model', model, '--dry-run', '--urdf', 'none',
                  '--json')
    assert bare['payload'] is None and bare['description'] is None


def test_without_a_description_numbers_order_the_joints(bags, capsys):
    result, _ = run(capsys, 'fit', bags / 'own', '--urdf', 'none', '--formulation', 'chain',
                    '--json')
    assert result['description'] is None and result['joint_order'] == 'numbers in the names'
    assert list(result['joints']) == list(JOINTS)
    some = ','.join(JOINTS[1::-1])
    result, _ = run(capsys, 'fit', bags / 'own', '--urdf', 'none', '--joints', some,
                    '--formulation', 'chain', '--json')
    assert list(result['joints']) == list(JOINTS[1::-1]) and result['joint_order'] == 'as asked'


def test_the_description_of_another_robot_is_ignored(bags, tmp_path, capsys):
    result, errors = run(capsys, 'fit', bags / 'other', '--formulation', 'chain', '--json')
    assert result['description'] is None
    assert 'robot description not used: /robot_description in other has no joint iiwa' in errors
    # A description named by the user must match.
    path = tmp_path / 'ur.urdf'
    path.write_text(robots.UR)
    assert main(['fit', str(bags / 'own'), '--urdf', str(path)]) == 1
    assert f'{path} has no joint iiwa_joint_1' in capsys.readouterr().err


@pytest.mark.parametrize('bag, argv, value, by', [
    ('leaning', (), WAIST, 'recording'), ('lacking', ('--fixed', f'waist={WAIST}'), WAIST,
                                          'option')])
def test_a_waist_that_is_not_a_joint_of_the_model(bags, capsys, bag, argv, value, by):
    result, _ = run(capsys, 'fit', bags / bag, '--joints', ','.join(JOINTS), *argv,
                    '--formulation', 'chain', '--json')
    assert result['description']['held'] == {'waist': {'value': pytest.approx(value), 'by': by}}
    assert result['report']['base_tilt'] == pytest.approx(0.0, abs=0.02)


def test_a_gripper_is_omitted_and_a_moving_waist_is_reported(bags, capsys):
    result, _ = run(capsys, 'fit', bags / 'lacking', '--formulation', 'chain', '--json')
    gripper = result['bags'][0]['facts'][0]
    assert (gripper['kind'], gripper['joints'], gripper['action']) == (
        'gripper', ['finger'], 'left_out')
    assert list(result['joints']) == list(JOINTS)
    # With an assumed angle of the waist the fit finds the tilt of the base.
    assert result['description']['held'] == {'waist': {'value': 0.0, 'by': 'assumption'}}
    assert result['report']['base_tilt'] == pytest.approx(WAIST, abs=0.02)
    _, errors = run(capsys, 'fit', bags / 'moving', '--joints', ','.join(JOINTS), '--formulation',
                    'chain', '--json')
    assert 'joint waist moves by 0.199 during the recordings' in errors


@pytest.mark.parametrize('argv, message', [
    (('--fixed', 'hip=1'), 'has no joint hip'), (('--fixed', 'iiwa_joint_1=1'), 'part of the arm'),
    (('--urdf', 'none', '--fixed', 'waist=1'), '--urdf is none'),
])
def test_an_invalid_fixed_joint_is_refused(bags, capsys, argv, message):
    assert main(['fit', str(bags / 'own'), *argv]) == 1
    assert message in capsys.readouterr().err
