"""`fit` and `update` with the robot description of a recording."""

from dataclasses import replace
import json
from math import pi

from bench.shared import urdf_snippets as robots
from bench.shared.command_line import run_json
from bench.shared.waisted_arm import IIWA, JOINTS, recording, WAIST, WAISTED
from gravity_comp_ros.api.axes import ArmOptions, known_arm
from gravity_comp_ros.api.read import read_recording
from gravity_comp_ros.cli import main
from gravity_comp_ros.description.joint_order import JointOrder
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.bag import ReadOptions
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


def test_info_uses_the_first_description_for_all_recordings(bags, tmp_path, capsys):
    named = tmp_path / 'iiwa.urdf'
    named.write_text(IIWA)
    both = 'info', bags / 'own', bags / 'other'
    assert run_json(capsys, *both)['motion'] == run_json(capsys, *both, '--urdf', named)['motion']


def test_the_recordings_own_description_is_used(bags, tmp_path, capsys):
    model = tmp_path / 'arm.json'
    assert main(['fit', str(bags / 'own'), '-o', str(model), '--json']) == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result['description'] == {
        'source': '/robot_description in own', 'joints': list(JOINTS), 'link': 'iiwa_link_7',
        'left_out': [], 'held': {}}
    assert result['joint_order'] == 'description' and 'warning' not in printed.err
    assert load_model(model).joints == JOINTS
    assert load_model(model).provenance['description']['source'] == '/robot_description in own'
    assert result['report']['known_axes']
    # The payload is estimated without a file argument.
    update = 'update', bags / 'tool', '--model', model, '--dry-run'
    payload = run_json(capsys, *update)
    assert payload['description']['source'] == '/robot_description in tool'
    assert payload['payload']['mass']['value'] == pytest.approx(2.0, rel=0.03)
    bare = run_json(capsys, *update, '--urdf', 'none')
    assert bare['payload'] is None and bare['description'] is None


def known(bag, joints=None, options=ReadOptions(), **axes):
    """Return the arm of a recording, as every verb knows it."""
    recording = read_recording([bag], replace(options, joints=joints), None)
    return known_arm(recording, ArmOptions(**axes, ordered=joints is not None))


def test_without_a_description_numbers_order_the_joints(bags):
    arm = known(bags / 'own', urdf='none')
    assert arm.to_json() is None
    assert (arm.order.source, arm.order.joints) == ('numbers and words in the names', JOINTS)
    some = JOINTS[1::-1]
    assert known(bags / 'own', some, urdf='none').order == JointOrder(some, 'as asked')


def test_the_description_of_another_robot_is_ignored(bags, tmp_path):
    arm = known(bags / 'other')
    assert arm.to_json() is None
    assert ('robot description not used: /robot_description in other has no joint iiwa'
            in arm.problem)
    # A description named by the user must match.
    path = tmp_path / 'ur.urdf'
    path.write_text(robots.UR)
    with pytest.raises(ModelMismatchError, match=f'{path} has no joint iiwa_joint_1'):
        known(bags / 'own', urdf=str(path))


@pytest.mark.parametrize('bag, fixed, value, by', [
    ('leaning', {}, WAIST, 'recording'), ('lacking', {'waist': WAIST}, WAIST, 'option'),
    ('lacking', {}, 0.0, 'assumption')])
def test_a_waist_that_is_not_a_joint_of_the_model(bags, bag, fixed, value, by):
    held = known(bags / bag, JOINTS, fixed=fixed).to_json()['held']
    assert held == {'waist': {'value': pytest.approx(value), 'by': by}}


@pytest.mark.parametrize('options, value', [
    ({}, WAIST), ({'position_unit': {'torso': 'deg'}}, WAIST * pi / 180),
    ({'zero': {'torso': 0.1}, 'reverse': ('torso',)}, 0.1 - WAIST)])
def test_a_waist_is_read_with_the_options_of_the_arm(bags, tmp_path, options, value):
    options = {'rename': {'waist': 'torso'}, **options}
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(WAISTED.replace('"waist"', '"torso"'))
    held = known(bags / 'leaning', JOINTS, ReadOptions(**options), urdf=urdf).to_json()['held']
    assert held == {'torso': {'value': pytest.approx(value), 'by': 'recording'}}


def test_check_names_joints_that_the_arm_carries_and_that_move(bags, capsys):
    main(['check', str(bags / 'own'), '--joints', ','.join(JOINTS[:5])])
    warning = capsys.readouterr().err
    assert all(f'joint {name} moves, and the arm carries it' in warning for name in JOINTS[5:])


def test_a_moving_waist_is_reported(bags):
    assert ('joint waist moves by 0.199 during the recordings'
            in known(bags / 'moving', JOINTS).problem)


def test_a_joint_that_moves_and_is_fixed_in_the_description_is_refused(bags, tmp_path):
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(WAISTED.replace('name="waist" type="revolute"', 'name="waist" type="fixed"'))
    with pytest.raises(DataError, match=f'waist moves by .* it is fixed in {urdf}.*correct its'):
        known(bags / 'moving', urdf=str(urdf))


def test_check_holds_a_waist_where_it_was_recorded(bags, capsys, tmp_path):
    assert main(['check', str(bags / 'leaning'), '--joints', ','.join(JOINTS), '--json',
                 str(tmp_path / 'faults.json')]) == 3
    assert 'carries it' not in capsys.readouterr().err
    # The gripper of the description is not on the recorded arm.
    (fault,) = json.loads((tmp_path / 'faults.json').read_text())['faults']
    assert fault['sentence'].startswith('the mass of tip')
