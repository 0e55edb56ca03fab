"""`info` on valid and invalid recordings, as text and JSON."""

import json

from bench.shared.recordings import messages, write_folder
from gravity_comp_ros.cli import main
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest


@pytest.fixture(scope='module')
def slow(tmp_path_factory):
    path = tmp_path_factory.mktemp('info') / 'slow.mcap'
    assert main(['synth', '--noise', '0.1', '-o', str(path)]) == 0
    return path


def info(capsys, *arguments):
    capsys.readouterr()
    assert main(['info', *map(str, arguments)]) == 0
    return capsys.readouterr().out


def test_words(slow, capsys):
    text = info(capsys, slow)
    assert '500 samples at 5 Hz over 99.8 s, velocity measured' in text
    assert 'slow samples 100.0 %, kept by the slow-motion gate 500' in text
    # Two pairs of joints move in step.
    assert 'iiwa_joint_4' in text and text.count('•') == 1
    assert 'the poses of 7 moving joints span 5 directions' in ' '.join(text.split())
    # The unit of effort is not given.
    command = f'gravity_comp check {slow} --urdf robot.urdf'
    assert command in text
    assert command not in info(capsys, slow, '--effort-scale', 'iiwa_joint_1=2')


def test_the_printed_commands_keep_gate_and_description(slow, capsys):
    text = info(capsys, slow, '--max-speed', '0.4', '--urdf', 'none')
    assert f'gravity_comp fit {slow} --urdf none --max-speed 0.4 -o ' in text
    assert f'gravity_comp check {slow} --max-speed 0.4 --urdf robot.urdf' in text
    text = info(capsys, slow, '--urdf', 'bags/iiwa7.urdf', '--all-samples')
    rest = f'{slow} --urdf bags/iiwa7.urdf --all-samples'
    assert f'gravity_comp fit {rest}' in text and f'gravity_comp check {rest}' in text


def test_json_has_every_recording(slow, tmp_path, capsys):
    fast = tmp_path / 'fast.mcap'
    main(['synth', '--motion', 'eq15', '-o', str(fast)])
    first, second = json.loads(info(capsys, slow, fast, '--json'))['recordings']
    assert first['name'] == 'slow.mcap' and first['slow_share'] == 1 and first['remarks'] == []
    assert first['joints']['iiwa_joint_1']['q_max'] == pytest.approx(0.65, abs=0.001)
    assert first['joints']['iiwa_joint_4']['max_speed'] == pytest.approx(0.1125, abs=0.001)
    assert second['slow_share'] == 0 and 'too fast' in second['remarks'][0]


def test_dropped_messages_and_chosen_joints(tmp_path, capsys):
    rows = messages(200)
    for number in (5, 6, 9):
        rows[number][1]['effort'][0] = float('nan')
    path = write_folder(tmp_path / 'bag', {'/joint_states': rows})
    assert 'dropped 3 of 200 messages: 3 position or effort missing' in info(capsys, path)
    (facts,) = json.loads(info(capsys, path, '--joints', 'wrist,elbow', '--json'))['recordings']
    assert list(facts['joints']) == ['wrist', 'elbow'] and facts['dropped'] == {}


def test_a_driver_that_publishes_zero_speed(tmp_path, capsys):
    path = tmp_path / 'x.mcap'
    t = np.arange(1200) / 30
    q = np.column_stack([np.sin(t), 0.1 * np.sin(0.5 * t)])
    write_bag(path, [JointTopic('/joint_states', ('a', 'b'), t, q, 0 * q, q)])
    text = info(capsys, path, '--accept', 'velocity')
    assert 'velocity measured' in text and 'slow samples 100.0 %' in text
    text = info(capsys, path)
    assert 'velocity differentiated' in text and 'driver does not measure it' in text
    assert 'too fast' in text
    (facts,) = json.loads(info(capsys, path, '--differentiate', '--json'))['recordings']
    assert facts['joints']['a']['max_speed'] == pytest.approx(1.0, abs=0.05)


def test_names_from_a_file_are_escaped(tmp_path, capsys):
    path = tmp_path / 'x.mcap'
    t = np.arange(60) / 10
    q = np.sin(t)[:, None]
    write_bag(path, [JointTopic('/joint_states', ('[red]\x1b[31mevil\n',), t, q, 0.1 * q, q)])
    text = info(capsys, path)
    assert '\x1b' not in text and '[red]' in text and 'evil' in text


def test_the_next_fit_inverts_efforts_that_oppose_friction(tmp_path, capsys):
    path = tmp_path / 'x.mcap'
    t = np.arange(600) / 10
    q = np.column_stack([np.sin(0.12 * t), np.sin(0.1 * t + 1.0)])
    qd = np.gradient(q, t, axis=0)
    tau = 5 * np.sin(q) + np.tanh(qd / 0.005)
    write_bag(path, [JointTopic('/joint_states', ('a', 'b'), t, q, qd, -1000 * tau)])
    last = info(capsys, path, '--effort-unit', 'mNm', '--effort-scale', '2=0.5').splitlines()[-1]
    assert last.split()[:3] == ['gravity_comp', 'fit', str(path)]
    assert '--effort-scale a=-1,b=-0.5 --effort-unit mNm' in last
    assert 'sign' not in info(capsys, path, '--effort-scale', 'a=-1,b=-1')
