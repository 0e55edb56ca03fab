"""`gravity_comp export` and `update --flange`: targets, output and bad input."""

from dataclasses import replace
import json
from pathlib import Path
import re

from bench.shared import urdf_snippets as snippets
from gravity_comp_ros.cli import main
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.export.payload_lines import (
    drive_lines, in_frame, load_of, Payload, payload_of)
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Quantity, Value
from gravity_comp_ros.models.model_file import load_model, save_model
import numpy as np
import pytest

BAGS = Path(__file__).resolve().parents[3] / 'bags'
TOOL = ('<link name="tool0"/><joint name="flange" type="fixed"><parent link="iiwa_link_7"/>'
        '<child link="tool0"/><origin xyz="0 0 0.045" rpy="0 0 1.5707963267948966"/></joint>'
        '</robot>')


@pytest.fixture(scope='module')
def folder(tmp_path_factory, iiwa_model_file):
    """Return a folder with a model, the model with 2 kg, and a description with a flange."""
    folder = tmp_path_factory.mktemp('export')
    text = (BAGS / 'iiwa7.urdf').read_text().replace('</robot>', TOOL)
    (folder / 'arm.urdf').write_text(text)
    (folder / 'arm.json').write_bytes(iiwa_model_file.read_bytes())
    assert main(['update', str(BAGS / 'eq17_2kg.mcap'), '--model', str(folder / 'arm.json'),
                 '--urdf', str(folder / 'arm.urdf'), '--flange', 'tool0', '-o',
                 str(folder / 'tool.json'), '--json', str(folder / 'update.json')]) == 0
    return folder


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def run(capsys, *arguments):
    status = main(['export', *arguments])
    printed = capsys.readouterr()
    return status, printed.out, printed.err


def test_c(here, tmp_path, capsys):
    status, out, _ = run(capsys, 'arm.json', '--to', 'c', '-o', str(tmp_path / 'new' / 'src'))
    assert status == 0 and 'chain of 7 joints; 91 parameters' in out
    assert {path.name for path in (tmp_path / 'new' / 'src').iterdir()} == {
        'gc_gravity.c', 'gc_gravity.h'}


def test_urdf_gives_the_load_to_the_last_link(here, tmp_path, capsys):
    output = tmp_path / 'new.urdf'
    status, out, _ = run(capsys, 'tool.json', '--to', 'urdf', '--urdf', 'arm.urdf', '-o',
                         str(output), '--json', str(tmp_path / 'r.json'))
    result = json.loads((tmp_path / 'r.json').read_text())
    links = result['links']
    assert status == 0 and f'wrote {output}' in out
    # 2 kg at 0.1 m: the first moment beyond the wrist is identified.
    moment = sum(links[name]['mass'] * links[name]['centre'][2]
                 - links[name]['mass_before'] * links[name]['centre_before'][2]
                 for name in ('iiwa_link_7',))
    assert 0.05 < moment < 0.35
    assert all(row['after'] < 0.05 for row in result['difference'].values())
    assert result['difference']['iiwa_joint_2']['before'] > 5.0


def test_effects_that_were_found_and_not_added_are_named(here, tmp_path, capsys):
    model = replace(load_model('arm.json'), provenance={'bags': [{'name': 'slow.mcap'}]})
    fitted = (AppliedEffect('coulomb_friction', 'iiwa_joint_4', {'distance': 0.001},
                            {'F_c': Value(0.8, 'N·m', (0.75, 0.85))}),
              AppliedEffect('torque_drift', 'iiwa_joint_2', {'origin': 0.0, 'time': 100.0},
                            {'r': Value(0.01, 'N·m/s', (0.009, 0.011)),
                             'b': Value(0.5, 'N·m', (0.4, 0.6))}))
    path = tmp_path / 'found.json'
    save_model(path, replace(model, fitted=Applied(fitted)))
    targets = {'c': ['-o', str(tmp_path / 'src')],
               'urdf': ['--urdf', 'arm.urdf', '-o', str(tmp_path / 'new.urdf')]}
    command = f'gravity_comp add coulomb_friction:iiwa_joint_4 slow.mcap --model {path}'
    for target, options in targets.items():
        status, out, err = run(capsys, str(path), '--to', target, *options)
        assert status == 0 and command in out
        # An effect that this target cannot contain is not named: to add it would not help.
        assert 'coulomb_friction:iiwa_joint_4 (F_c = 0.800 ± 0.050 N·m)' in err
        assert 'torque_drift' not in out + err
        status, out, _ = run(capsys, str(path), '--to', target, *options, '--json')
        result = json.loads(out)
        assert result['not_added'] == ['coulomb_friction:iiwa_joint_4']
        assert result['add'] == command
    (tmp_path / 'src').joinpath('gc_gravity.c').unlink()
    status, out, err = run(capsys, 'arm.json', '--to', 'c', '-o', str(tmp_path / 'src'), '--json')
    assert json.loads(out)['add'] is None and err == ''


def test_the_torque_at_rest_of_an_effect_that_is_left_out_is_named(here, tmp_path, capsys):
    spring = AppliedEffect('joint_spring', 'iiwa_joint_2', {'centre': 0.0, 'overtones': 0.0}, {
        'k': Value(0.0, 'N·m/rad', (-1.0, 1.0)), 'm': Value(20.0, 'N·m', (19.0, 21.0))})
    drift = AppliedEffect('torque_drift', 'iiwa_joint_2', {'origin': 0.0, 'time': 100.0}, {
        'r': Value(0.01, 'N·m/s', (0.009, 0.011)), 'b': Value(0.5, 'N·m', (0.4, 0.6))})
    path = tmp_path / 'spring.json'
    save_model(path, replace(load_model('arm.json'), applied=Applied((spring, drift))))
    status, _, err = run(capsys, str(path), '--to', 'urdf', '--urdf', 'arm.urdf', '-o',
                         str(tmp_path / 'new.urdf'))
    of_spring, of_drift = err.splitlines()
    assert status == 0 and 'holds up to 20 N·m of iiwa_joint_2 at rest' in of_spring
    assert 'at rest' not in of_drift


def test_payload_lines_in_the_frame_of_the_flange(here, capsys):
    status, out, _ = run(capsys, 'tool.json', '--to', 'payload', '--urdf', 'arm.urdf',
                         '--flange', 'tool0')
    assert status == 0
    ur = re.search(r'set_target_payload\(([\d.]+), \[(.*)\]\)', out)
    x, y, z = map(float, ur[2].split(','))
    assert float(ur[1]) == pytest.approx(2.0, abs=0.02)
    # (0, 0, 0.1) in link 7 is (0, 0, 0.055) beyond a flange at 0.045.
    assert (x, y, z) == pytest.approx((0.0, 0.0, 0.055), abs=0.003)
    kuka = re.search(r'LOAD_DATA\[1\]=\{M ([\d.]+),CM \{X (.*),Y (.*),Z ([\d.]+),A 0', out)
    assert float(kuka[4]) == pytest.approx(1e3 * z, abs=0.06)
    for maker in ('set_payload ur_msgs', 'robot.setLoad(', 'franka_msgs/srv/SetLoad',
                  'arm.set_tcp_load(', 'config.SetToolConfiguration(tool)'):
        assert maker in out
    update = json.loads((here / 'update.json').read_text())['flange']
    assert update['frame'] == 'tool0'
    assert update['centre']['z']['value'] == pytest.approx(z, abs=1e-4)
    low, high = update['centre']['z']['ci95']
    assert abs(z - 0.055) < high - low


def test_lines_of_a_payload_repeat_the_warnings_of_its_update(here, tmp_path, capsys):
    model = load_model('tool.json')
    last = {**model.provenance['updates'][-1], 'warnings': ['no rigid body']}
    path = tmp_path / 'tool.json'
    save_model(path, replace(model, provenance={**model.provenance, 'updates': [last]}))
    status, out, err = run(capsys, str(path), '--to', 'payload')
    assert status == 0 and 'set_target_payload' in out and err == 'warning: no rigid body\n'
    assert json.loads(run(capsys, str(path), '--to', 'payload', '--json')[1])['warnings'] == [
        'no rigid body']


def test_a_payload_in_another_frame_by_hand():
    joints = snippets.UR_JOINTS
    arm = described_arm(snippets.UR, joints)
    link = f'{joints[-1]}_link'
    centre = {axis: Quantity(value, 'm', (value - half, value + half))
              for axis, value, half in (('x', 0.1, 0.01), ('y', 0.2, 0.02), ('z', 0.3, 0.03))}
    # The flange is 0.3 m along z (urdf_snippets.joint), not turned.
    moved = in_frame(Payload(link, Quantity(2.0, 'kg', (1.9, 2.1)), centre), arm, 'tool0')
    np.testing.assert_allclose([x.value for x in moved.centre.values()], [0.1, 0.2, 0.0],
                               atol=1e-12)
    np.testing.assert_allclose([0.5 * np.ptp(x.ci95) for x in moved.centre.values()],
                               [0.01, 0.02, 0.03], atol=1e-12)
    with pytest.raises(GravityCompError, match='turns against'):
        in_frame(moved, arm, f'{joints[-2]}_link')


@pytest.mark.parametrize('second', [1.0, -1.0, -2.0, None])
def test_the_lines_give_the_whole_load_after_two_updates(here, second):
    """A drive replaces its setting; a sum that is unknown or not there has no line."""
    def update(mass, x):
        quantity = {'value': mass, 'unit': 'kg', 'ci95': (mass - 0.03, mass + 0.03)}
        centre = {axis: {'value': c, 'unit': 'm', 'ci95': (c - 0.01, c + 0.01)}
                  for axis, c in zip('xyz', (x, 0.0, 0.1))}
        return {'payload': {'link': 'wrist', 'mass': quantity, 'centre': centre}}

    model = load_model('tool.json')
    last = {} if second is None else update(second, 0.3)
    model = replace(model, provenance={**model.provenance, 'updates': [update(2.0, 0.0), last]})
    if second in (None, -2.0):
        with pytest.raises(GravityCompError, match='no known sum|no estimate'):
            load_of(model)
        return
    load = load_of(model)
    assert load.mass.value == pytest.approx(2.0 + second)
    assert load.centre['x'].value == pytest.approx(0.3 * second / (2.0 + second))
    assert load.centre['z'].value == pytest.approx(0.1)
    low, high = load.mass.ci95
    assert high - low == pytest.approx(2 * 0.03 * 2 ** 0.5)
    low, high = load.centre['z'].ci95
    assert 0.005 < 0.5 * (high - low) < 0.03
    assert f'set_target_payload({2.0 + second:.3f}' in drive_lines(load)[0].line


def test_a_removed_payload_has_no_line(here):
    payload = payload_of(load_model('tool.json'))
    removed = Payload(payload.frame, Quantity(-2.0, 'kg', (-2.1, -1.9)), payload.centre)
    with pytest.raises(GravityCompError, match=r'removed 2\.000 kg'):
        drive_lines(removed)


def test_a_flange_that_is_not_there_is_refused_before_the_update(here, capsys):
    assert main(['update', str(BAGS / 'eq17_2kg.mcap'), '--model', 'arm.json', '--urdf',
                 'arm.urdf', '--flange', 'tool9', '-o', 'never.json']) == 1
    assert 'carries no link tool9' in capsys.readouterr().err
    assert not (here / 'never.json').exists()
