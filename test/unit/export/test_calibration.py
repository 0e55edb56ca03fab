"""`calibrate`: torque per unit of effort from a known weight."""

from dataclasses import replace
import json
from pathlib import Path

from gravity_comp_ros.calibration.known_weight import calibrate, Weight, WeightOptions
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.errors import DataError, GravityCompError, OptionError
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest

BAGS = Path(__file__).resolve().parents[3] / 'bags'
URDF = (BAGS / 'iiwa7.urdf').read_text()
JOINTS = tuple(f'iiwa_joint_{n}' for n in range(1, 8))
LINK = 'iiwa_link_7'
CONSTANTS = np.array([1.0, 0.7, -1.3, 0.05, 1.2, 40.0, 1.0])


@pytest.fixture(scope='module')
def bags():
    return [slow_samples(read_bag(BAGS / f'eq17_{name}.mcap').samples).samples
            for name in ('unloaded', '2kg')]


@pytest.fixture(scope='module')
def arm():
    return described_arm(URDF, JOINTS)


def as_efforts(samples):
    """Return the samples in units of effort: torque over N·m per unit."""
    return replace(samples, tau=samples.tau / CONSTANTS)


@pytest.mark.parametrize('centre', [None, (0.0, 0.0, 0.1)])
def test_constants_of_any_size_and_sign(bags, arm, centre):
    empty, loaded = map(as_efforts, bags)
    result = calibrate(empty, loaded, arm, Weight(LINK, 2.0, centre))
    assert {'iiwa_joint_2', 'iiwa_joint_3', 'iiwa_joint_4', 'iiwa_joint_6'} <= set(result.scales)
    assert {'iiwa_joint_1', 'iiwa_joint_7'} <= set(result.left_out)
    for joint, scale in result.scales.items():
        true = CONSTANTS[JOINTS.index(joint)]
        low, high = scale.ci95
        assert scale.value == pytest.approx(true, rel=0.02) and low < true < high, joint
    assert result.centre['z'].value == pytest.approx(0.1, abs=0.005)


def test_one_joint_by_hand():
    # A pendulum of first moment 1.2 kg m; 2 kg at 0.5 m beyond; effort = torque / 0.3, no noise.
    text = ('<robot name="p"><link name="b"/><link name="l"/><joint name="j" type="revolute">'
            '<parent link="b"/><child link="l"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" '
            'effort="1" velocity="1"/></joint></robot>')
    arm, t = described_arm(text, ['j']), np.arange(0.0, 60.0, 0.2)
    parts = []
    for moment in (1.2, 1.2 + 2.0 * 0.5):
        q = np.sin(0.1 * t + moment)[:, None]
        torque = 9.80665 * moment * np.sin(q) + 0.7 + 0.2 * np.tanh(np.cos(0.1 * t + moment)
                                                                    / 0.1)[:, None]
        parts.append(JointSamples.single_run(('j',), t, q, 0.1 * np.cos(0.1 * t + moment)[:, None],
                                             torque / 0.3))
    # Hanging along -z at angle 0: the weight is at z = -0.5.
    result = calibrate(*parts, arm, Weight('l', 2.0, (0.0, 0.0, -0.5)))
    assert result.scales['j'].value == pytest.approx(0.3, rel=1e-6)


def test_what_cannot_be_calibrated_is_refused(bags, arm):
    empty, loaded = bags
    with pytest.raises(DataError, match='the effort of no joint'):
        calibrate(empty, slow_samples(read_bag(BAGS / 'eq17_later.mcap').samples).samples, arm,
                  Weight(LINK, 2.0))
    with pytest.raises(DataError, match='with weight has 20'):
        calibrate(empty, loaded.select(np.arange(20)), arm, Weight(LINK, 2.0))
    with pytest.raises(GravityCompError, match='carries no link tool'):
        calibrate(empty, loaded, arm, Weight('tool', 2.0))
    for wrong in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(OptionError, match='must be positive'):
            Weight(LINK, wrong)
    with pytest.raises(OptionError, match='not finite'):
        Weight(LINK, 1.0, (0.0, np.nan, 0.0))
    with pytest.raises(OptionError, match='must be positive'):
        WeightOptions(distance=0.0)


def test_one_offset_for_both_recordings_gives_smaller_intervals(bags, arm):
    free, same = (calibrate(*bags, arm, Weight(LINK, 2.0), WeightOptions(same_offset=same))
                  for same in (False, True))
    for joint in ('iiwa_joint_2', 'iiwa_joint_4'):
        assert np.ptp(same.scales[joint].ci95) < 0.95 * np.ptp(free.scales[joint].ci95)
        assert same.scales[joint].value == pytest.approx(1.0, abs=0.01)


@pytest.fixture
def recordings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, stem in (('empty', 'unloaded'), ('loaded', '2kg')):
        samples = read_bag(BAGS / f'eq17_{stem}.mcap').samples
        write_bag(tmp_path / f'{name}.mcap', [joint_states(as_efforts(samples))])
    return ['calibrate', 'empty.mcap', 'loaded.mcap', '--mass', '2', '--urdf',
            str(BAGS / 'iiwa7.urdf')]


def test_the_printed_option_calibrates(recordings, capsys):
    assert main([*recordings, '--json', 'r.json']) == 0
    assert 'centre of mass of the weight in the frame of iiwa_link_7' in capsys.readouterr().out
    option = json.loads(Path('r.json').read_text())['option']
    assert main([*recordings, *option.split(), '--json', 'again.json']) == 0
    first, again = (json.loads(Path(name).read_text())['joints'] for name in (
        'r.json', 'again.json'))
    for joint in first:
        assert again[joint]['scale']['value'] == pytest.approx(first[joint]['scale']['value'],
                                                               rel=1e-3)


@pytest.mark.parametrize(('change', 'status', 'message'), [
    (lambda a: [*a[:2], a[1], *a[3:]], 1, 'named as the recording without and with'),
    (lambda a: [*a[:4], '-2', *a[5:]], 2, 'not above 0'),
    (lambda a: [*a, '--com', '0', '0'], 2, 'expected 3 arguments'),
    (lambda a: [*a, '--link', 'tool9'], 1, 'carries no link tool9'),
    (lambda a: [a[0], a[2], a[1], *a[3:]], 1, 'the arm would weigh -1.2'),
    (lambda a: [*a[:4], '1e9', *a[5:]], 1, 'check the mass'),
    (lambda a: a[:5], 1, 'name a file with --urdf')])
def test_bad_input_is_one_line(recordings, capsys, change, status, message):
    assert main(change(recordings)) == status
    captured = capsys.readouterr()
    assert captured.out == '' and captured.err.count('\n') == 1 and message in captured.err
