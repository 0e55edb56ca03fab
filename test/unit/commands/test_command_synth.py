"""`synth` writes the requested recording, and refuses invalid options in one line."""

import json

from bench.shared.command_line import refused
from gravity_comp_ros.cli import main
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.simulation import arms, motions
import numpy as np
import pytest

URDF = """
<robot name="one"><link name="base"/><link name="rod"><inertial><origin xyz="0.5 0 0"/>
<mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="swing" type="{}"><parent link="base"/><child link="rod"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="3" effort="9"/></joint></robot>
"""


def synth(tmp_path, *arguments):
    path = tmp_path / 'x.mcap'
    assert main(['synth', *arguments, '-o', str(path)]) == 0
    return read_bag(path).samples


def test_eq17_is_the_default(tmp_path, capsys):
    samples = synth(tmp_path)
    motion = motions.eq17()
    np.testing.assert_array_equal(samples.q, motion.q)
    np.testing.assert_array_equal(samples.qd, motion.qd)
    expected = arms.inverse_dynamics(arms.iiwa7(), motion.q, motion.qd, motion.qdd)
    np.testing.assert_array_equal(samples.tau, expected)
    assert '500 samples of 7 joints' in capsys.readouterr().out


def test_payload_time_counts_from_the_start_of_the_bag(tmp_path):
    common = ('--start', '50', '--duration', '20')
    bare = synth(tmp_path, *common)
    loaded = synth(tmp_path, *common, '--payload', '2', '--payload-at', '10')
    changed = np.abs(loaded.tau - bare.tau).max(axis=1) > 0
    assert changed.tolist() == [False] * 50 + [True] * 50


def test_noise_seed_and_static(tmp_path):
    one = synth(tmp_path, '--noise', '0.1', '--seed', '5')
    same = synth(tmp_path, '--noise', '0.1', '--seed', '5')
    other = synth(tmp_path, '--noise', '0.1', '--seed', '6')
    np.testing.assert_array_equal(one.tau, same.tau)
    assert np.abs(one.tau - other.tau).max() > 0.1
    static = synth(tmp_path, '--static')
    np.testing.assert_array_equal(static.tau, arms.gravity_torque(arms.iiwa7(), static.q))
    assert not static.qd.any()


def test_urdf_with_a_multisine_and_a_tilted_base(tmp_path):
    path = tmp_path / 'one.urdf'
    path.write_text(URDF.format('revolute'))
    arguments = ('--arm', str(path), '--motion', 'multisine', '--max-speed', '0.2', '--rate',
                 '10', '--static')
    level = synth(tmp_path, *arguments)
    assert level.names == ('swing',) and len(level) == 1000
    np.testing.assert_allclose(level.tau, -9.80665 * np.cos(level.q), atol=1e-12)
    tilted = synth(tmp_path, *arguments, '--tilt', '0', '30', '--joint-names', 'elbow')
    assert tilted.names == ('elbow',)
    np.testing.assert_allclose(tilted.tau, -9.80665 * np.cos(tilted.q + np.pi / 6), atol=1e-9)


def test_json_and_limits(tmp_path, capsys):
    path = tmp_path / 'x.mcap'
    assert main(['synth', '--motion', 'eq15', '--json', '-o', str(path)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts['n_samples'] == 200 and facts['output'] == str(path)
    assert facts['notes'] == ['joint iiwa_joint_5 exceeds its limit by 0.033 rad']


@pytest.mark.parametrize(('arguments', 'message'), [
    (('--arm', 'puma'), 'no arm puma'), (('--arm', 'none.urdf'), 'cannot read URDF none.urdf'),
    (('--noise', '-1'), 'absolute is -1'), (('--motion', 'none.yaml'), 'no such file'),
    (('--samples', '5', '--duration', '5'), 'not both'), (('--max-speed', '1'), 'multisine'),
    (('--payload-com', '0', '0', '1'), 'requires --payload'),
    (('--payload-at', '5'), 'needs a payload'), (('--joint-names', 'a,b'), '7 joints'),
    (('--duration', '0.01'), 'no sample'), (('--topic', 'joints'), 'slash')])
def test_one_line_for_invalid_options(tmp_path, capsys, arguments, message):
    assert message in refused(capsys, 'synth', *arguments, '-o', tmp_path / 'x.mcap')
    assert not list(tmp_path.iterdir())


def test_prismatic_joint_and_wrong_arm_for_a_motion(tmp_path, capsys):
    path = tmp_path / 'one.urdf'
    for kind, message in (('prismatic', 'swing'), ('revolute', 'for 7 joints and one has 1')):
        path.write_text(URDF.format(kind))
        assert message in refused(capsys, 'synth', '--arm', path, '-o', tmp_path / 'x.mcap')
