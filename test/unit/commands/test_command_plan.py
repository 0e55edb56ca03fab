"""Commands `synth` and `plan`: what they write, and invalid options."""

import json

from bench.shared import urdf_snippets as robots
from bench.shared.command_line import refused
from bench.shared.planning_arm import model, NAMES, one_way
from gravity_comp_ros.cli import main
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.planning.trajectory_files import read_trajectory
from gravity_comp_ros.recordings.bag import read_bag, RecordedDescription
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation import arms, motions
import numpy as np
import pytest


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('plan')
    write_bag(folder / 'old.mcap', [joint_states(one_way(0))])
    save_model(folder / 'arm.json', model())
    (folder / 'arm.urdf').write_text(robots.robot(robots.arm(NAMES, 'base_link', twist='0 0 0')))
    return folder


def command(folder, output, *argv):
    return ['plan', str(folder / 'old.mcap'), '--model', str(folder / 'arm.json'), '--settle',
            'coulomb_friction:elbow', '--duration', '12', '-o', str(output), *map(str, argv)]


def test_a_plan_is_written_shown_and_played(folder, tmp_path, capsys):
    motion = tmp_path / 'motion.yaml'
    assert main(command(folder, motion)) == 0
    output = capsys.readouterr().out
    for message in (' s: elbow ', 'coulomb_friction:elbow', 'move the arm to',
                    'obstacles are not checked', f'written to {motion}'):
        assert message in ' '.join(output.split())
    again = tmp_path / 'again.yaml'
    assert main(command(folder, again, '--effort', '--json')) == 0
    document = json.loads(capsys.readouterr().out)
    (expected,) = document['expected']
    assert expected['effect'] == 'coulomb_friction' and expected['joint'] == 'elbow'
    assert expected['chance'] > expected['chance_before']
    assert document['duration_s'] <= 12.0
    trajectory = read_trajectory(again)
    np.testing.assert_allclose(trajectory.q[0], document['start'], atol=6e-6)
    assert trajectory.effort is not None
    # The simulated arm follows the file, with joints matched by name.
    out = tmp_path / 'new.mcap'
    assert main(['synth', '--arm', str(folder / 'arm.urdf'), '--motion', str(motion), '--noise',
                 '0.01', '-o', str(out)]) == 0
    moved = read_bag(out).samples
    at = np.interp(moved.t, trajectory.t, trajectory.q[:, 1])
    np.testing.assert_allclose(moved.q[:, moved.names.index('elbow')], at, atol=2e-3)
    assert main(['synth', '--motion', str(motion), '-o', str(tmp_path / 'x.mcap')]) == 1
    assert 'moves shoulder, elbow, wrist, but the joints of iiwa7' in capsys.readouterr().err


def test_a_recorded_range_is_widened(folder, tmp_path, capsys):
    old = read_bag(folder / 'old.mcap').samples.q
    out, ends = tmp_path / 'wide.yaml', (old.min(axis=0), old.max(axis=0))
    assert main(command(folder, out, '--settle', 'torque_offset', '--widen', 0.4)) == 0
    assert 'no description gives the position limits' in capsys.readouterr().err
    q = read_trajectory(out).q
    assert (q >= ends[0] - 0.4 - 6e-6).all() and (q <= ends[1] + 0.4 + 6e-6).all()
    assert (q < ends[0] - 0.05).any() or (q > ends[1] + 0.05).any()


def test_a_plan_for_gravity_alone_has_no_empty_table(folder, tmp_path, capsys):
    assert main(command(folder, tmp_path / 'motion.yaml', '--settle', 'gravity')) == 0
    printed = capsys.readouterr().out
    assert 'gravity torque of' in printed and 'expected results' not in printed


@pytest.mark.parametrize('joint, is_used', [('elbow', True), ('knee', False)])
def test_a_widened_range_ends_at_the_limits_of_the_recorded_description(
        folder, tmp_path, capsys, joint, is_used):
    text = (folder / 'arm.urdf').read_text().replace('"elbow"', f'"{joint}"').replace(
        '"3"', '"0.4"').replace('"-3"', '"-0.4"')
    bag, out = tmp_path / 'old.mcap', tmp_path / 'wide.yaml'
    samples = read_bag(folder / 'old.mcap').samples
    write_bag(bag, [joint_states(samples)],
              description=RecordedDescription(text, '/robot_description', bag))
    line = command(folder, out, '--settle', 'torque_offset', '--widen', '7')
    assert main([line[0], str(bag), *line[2:]]) == 0
    q, printed = read_trajectory(out).q, capsys.readouterr()
    limit = np.maximum(np.abs(samples.q).max(axis=0), 0.96 * 0.4)
    assert (np.abs(q) <= limit + 6e-6).all() == is_used
    assert ('no joint elbow' in ' '.join(printed.out.split())) != is_used
    assert ('no description gives the position limits' in printed.err) != is_used


def test_wider_limits_are_advised_where_they_are_needed(folder, tmp_path, capsys):
    # Over 0.05 rad gravity is nearly collinear with an offset.
    write_bag(tmp_path / 'old.mcap', [joint_states(one_way(0, span=0.05))])
    line = command(folder, tmp_path / 'motion.yaml', '--settle', 'torque_offset:elbow')
    line = [line[0], str(tmp_path / 'old.mcap'), *line[2:]]
    assert main(line) == 1
    assert 'widen the position limits' in ' '.join(capsys.readouterr().err.split())
    assert main([*line, '--widen', '0.7', '--duration', '20']) == 0
    assert '--widen' not in capsys.readouterr().err


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
    # Limits that a motion exceeds are noted.
    path = tmp_path / 'x.mcap'
    assert main(['synth', '--motion', 'eq15', '--json', '-o', str(path)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts['n_samples'] == 200 and facts['output'] == str(path)
    assert facts['notes'] == ['joint iiwa_joint_5 exceeds its limit by 0.033 rad']


def test_payload_time_counts_from_the_start_of_the_bag(tmp_path):
    bare, loaded = (synth(tmp_path, '--start', '50', '--duration', '20', *more)
                    for more in ((), ('--payload', '2', '--payload-at', '10')))
    changed = np.abs(loaded.tau - bare.tau).max(axis=1) > 0
    assert changed.tolist() == [False] * 50 + [True] * 50


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


def test_prismatic_joint_and_wrong_arm_for_a_motion(tmp_path, capsys):
    path = tmp_path / 'one.urdf'
    for kind, message in (('prismatic', 'swing'), ('revolute', 'for 7 joints and one has 1')):
        path.write_text(URDF.format(kind))
        assert message in refused(capsys, 'synth', '--arm', path, '-o', tmp_path / 'x.mcap')
