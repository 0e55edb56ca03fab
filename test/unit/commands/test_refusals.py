"""Wrong input of users: one line of error message, and no file written or changed."""

import json
import shlex

from bench.shared.command_line import refused, run_json
from bench.shared.rough_links import two_link_urdf, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import joint_named
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import joint_states, JointTopic, write_bag
import numpy as np
import pytest

T = np.arange(500) / 5.0
Q = np.column_stack([0.6 * np.sin(0.1 * T), 0.7 * np.cos(0.07 * T)])
QD = np.column_stack([0.06 * np.cos(0.1 * T), -0.049 * np.sin(0.07 * T)])
TAU = np.column_stack([10 * np.sin(Q[:, 0]) + 3 * np.sin(Q.sum(axis=1)),
                       3 * np.sin(Q.sum(axis=1))]) \
    + np.random.default_rng(0).normal(scale=0.05, size=(500, 2))


def bag(path, t=T, q=Q, tau=TAU):
    write_bag(path, [JointTopic('/joint_states', ('shoulder', 'elbow'), t, q, QD[:len(t)], tau)])
    return str(path)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with recordings, a table, descriptions and a model of two links."""
    folder = tmp_path_factory.mktemp('files')
    bag(folder / 'good.mcap')
    for name, samples in {'rough': two_links(1), 'other': two_links(6, names=('a', 'b')),
                          'few': two_links(4, count=24),
                          'one_way': two_links(5, one_way=True)}.items():
        write_bag(folder / f'{name}.mcap', [joint_states(samples)])
    (folder / 'cut.mcap').write_bytes((folder / 'good.mcap').read_bytes()[:5000])
    (folder / 'log.csv').write_text('q_0,tau_0\n' + '0.1,2\n' * 40)
    (folder / 'arm.urdf').write_text(two_link_urdf())
    (folder / 'other.urdf').write_text('<robot name="r"><link name="l"/></robot>')
    assert main(['fit', str(folder / 'good.mcap'), '-o', str(folder / 'arm.json')]) == 0
    return folder


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


# Exit status, call, and a part of the message. A test of its reader has the other messages of
# tables, recordings, descriptions and models.
REFUSALS = [
    (2, 'nonsense', 'unknown verb nonsense'),
    (2, '--nonsense', 'unknown option'),
    (2, 'synth -o x.mcap --tilt 90 900', 'not within -180 to 180'),
    (2, 'synth -o x.mcap --samples 0', 'not a positive integer'),
    (2, 'synth -o x.mcap --motion dance', 'dance does not end in .yaml'),
    (2, 'synth -o x.mcap --rate nan', 'not a number above 0'),
    (1, 'synth -o x.mcap --duration 1e9', 'shorten --duration or lower --rate'),
    (1, 'synth -o x.mcap --duration 0.01', 'no sample'),
    (1, 'synth -o x.mcap --arm puma', 'cannot read URDF puma'),
    (1, 'synth -o x.mcap --arm none.urdf', 'read URDF none.urdf: no such file'),
    (1, 'synth -o x.mcap --arm arm.urdf', 'for 7 joints and two has 2'),
    (1, 'synth -o x.mcap --noise -1', 'absolute is -1'),
    (1, 'synth -o x.mcap --motion none.yaml', 'no such file'),
    (1, 'synth -o x.mcap --samples 5 --duration 5', 'not both'),
    (1, 'synth -o x.mcap --max-speed 1', 'multisine'),
    (1, 'synth -o x.mcap --payload-com 0 0 1', 'requires --payload'),
    (1, 'synth -o x.mcap --payload-at 5', 'needs a payload'),
    (1, 'synth -o x.mcap --joint-names a,b', '7 joints'),
    (1, 'synth -o x.mcap --topic joints', 'slash'),
    (2, 'convert log.csv', 'required: -o'),
    (2, 'convert log.csv -o x.csv', 'does not end in .mcap'),
    (2, 'convert log.csv -o x.mcap --position-unit grad', 'is not rad, deg or ticks'),
    (1, 'convert log.csv -o good.mcap', 'no column of time'),
    (1, 'convert log.csv -o good.mcap --rate 9 --time q_0', 'not both'),
    (1, 'convert log.csv -o good.mcap --rate 9 --delimiter ::', 'one character'),
    (1, 'convert log.csv -o good.mcap --rate 9 --effort-unit A', 'torque constant'),
    (1, 'convert log.csv -o good.mcap --rate 9 --effort-sign 1,1', '2 effort signs for 1 joints'),
    (1, 'cut good.mcap -o part.mcap --from 3 --to 2', 'must increase'),
    (1, 'cut good.mcap -o part.mcap --split 4,500', 'must increase'),
    (1, 'cut good.mcap -o part.mcap --from 0.05 --to 0.1', 'no samples'),
    (1, 'cut good.mcap -o part.mcap --joints elbow,z', 'z'),
    (1, 'info cut.mcap --json', 'truncated'),
    (1, 'info none.mcap', 'no such recording'),
    (1, 'info good.mcap --joints x', 'no joint x'),
    (1, 'info good.mcap --topic /x', 'no topic /x'),
    (1, 'info good.mcap other.mcap', 'different robots'),
    (1, 'info good.mcap --all-samples --max-speed 1', 'omit --max-speed and --rate'),
    (2, 'fit', 'BAG'),
    (2, 'fit good.mcap --max-speed fast', 'not a number'),
    (2, 'fit good.mcap --rate -1', 'not a number above 0'),
    (2, 'fit good.mcap --effort-scale elbow=0', 'not a number other than 0'),
    (2, 'fit good.mcap --joints a,,b', 'empty joint name'),
    (2, 'fit --json good.mcap', 'put --json after the bags'),
    (2, 'fit good.mcap --formul potential', 'unrecognized'),
    (1, 'fit log.csv', 'is a table, not a recording: first `gravity_comp convert '),
    (1, 'fit good.mcap --joints 1,3', 'no joint 3 (to be read); it has shoulder, elbow'),
    (1, 'fit good.mcap --joints 2,elbow', 'a joint is named twice'),
    (1, 'fit good.mcap other.mcap', 'different'),
    (1, 'fit good.mcap --holdout 1.5', 'between 0 and 1'),
    (1, 'fit good.mcap --urdf arm.urdf --formulation potential',
     'potential does not use a robot description'),
    (1, 'fit good.mcap --urdf arm.urdf --fixed hip=1', 'has no joint hip'),
    (1, 'fit good.mcap --urdf arm.urdf --fixed elbow=1', 'part of the arm'),
    (1, 'fit good.mcap --urdf none --fixed waist=1', 'none is to be used'),
    (2, 'compare good.mcap --model m.json --html good.mcap', 'does not end in .html'),
    (1, 'compare good.mcap --model arm.json --max-speed 1e-6', 'use all samples (--all-samples'),
    (1, 'compare other.mcap --model arm.json', 'no joint shoulder'),
    (1, 'compare good.mcap --model arm.json --joints wrist', 'no joint wrist'),
    (1, 'compare good.mcap --model arm.json --holdout', 'was fitted without --holdout'),
    (1, 'compare good.mcap --model good.mcap', 'good.mcap'),
    (1, 'compare good.mcap --model none.json', 'none.json'),
    (1, 'diagnose other.mcap --model arm.json', 'shoulder'),
    (1, 'diagnose few.mcap --model arm.json', 'too few'),
    (1, 'diagnose good.mcap --effects viscos_friction', 'did you mean viscous_friction?'),
    (1, 'diagnose good.mcap --model arm.json --joints shoulder', '--joints'),
    (2, 'add --model m.json', 'name an effect and at least one bag'),
    (2, 'add torque_offset good.mcap --model m.json --undo', 'takes no effect and no bag'),
    (2, 'add --undo', 'required: --model'),
    (2, 'add coulomb_friction viscous_friction good.mcap --model arm.json',
     'separate effects with comma'),
    (1, 'add --undo --model arm.json', 'no addition to undo'),
    (1, 'add coulom:shoulder good.mcap --model arm.json', 'did you mean coulomb_friction?'),
    (1, 'add coulomb_friction:sholder good.mcap --model arm.json', 'did you mean shoulder?'),
    (1, 'add coulomb_friction:3 good.mcap --model arm.json', 'it has shoulder, elbow, or 1 to 2'),
    (1, 'add coulomb_friction:elbow,coulomb_friction good.mcap --model arm.json',
     'requested twice'),
    (1, 'add base_tilt:shoulder good.mcap --model arm.json', 'whole arm'),
    (1, 'add torque_offset:shoulder few.mcap --model arm.json', 'too few'),
    (1, 'add coulomb_friction:shoulder one_way.mcap --model arm.json', 'one direction only'),
    (2, 'update --model arm.json', 'at least one bag'),
    (2, 'update good.mcap --undo --model arm.json', 'at least one bag'),
    (1, 'update few.mcap --model arm.json', 'slow samples'),
    (1, 'update good.mcap --model arm.json --urdf none.urdf', 'no such file'),
    (1, 'update good.mcap --model arm.json --urdf other.urdf', 'has no joint'),
    (1, 'replay good.mcap --model arm.json -o out.mcap --joints shoulder', 'no joint elbow'),
    (1, 'replay good.mcap --model arm.json -o out.mcap --topic /x', 'no topic /x'),
    (2, 'plan good.mcap --model arm.json -o m.yaml --widen -1', 'not a number above 0'),
    (2, 'plan good.mcap --model arm.json -o m.yaml --max-speed 0', 'not a number above 0'),
    (1, 'plan good.mcap --model arm.json -o m.yaml --settle rust:elbow', 'no effect'),
    (1, 'plan good.mcap --model arm.json -o m.yaml --settle torque_offset:elbow --start 9,9',
     'start pose'),
    (1, 'plan good.mcap --model arm.json -o m.yaml --settle torque_offset:elbow --duration 0.5',
     'no motion of 0.5 s'),
    (2, 'export arm.json', '--to'),
    (2, 'export arm.json --to c', '--to c needs -o PATH'),
    (2, 'export arm.json --to c -o x --urdf arm.urdf', '--urdf is not for --to c'),
    (1, 'export arm.json --to c -o x --prefix 9', 'is not a C name'),
    (1, 'export arm.json --to c -o arm.urdf', 'cannot write to the folder'),
    (1, 'export none.json --to c -o x', 'cannot read model'),
    (2, 'export arm.json --to urdf -o x', 'needs the description to correct'),
    (1, 'export arm.json --to urdf --urdf none.urdf -o x', 'cannot read URDF'),
    (1, 'export arm.json --to urdf --urdf arm.urdf -o arm.urdf', 'would be overwritten'),
    (1, 'export arm.json --to urdf --urdf other.urdf -o x', 'other.urdf has no joint'),
    (1, 'export arm.json --to mjcf --mjcf arm.urdf -o x', 'is not an MJCF'),
    (1, 'export arm.json --to payload', 'no estimate of a payload'),
    (2, 'export arm.json --to payload -o x', 'takes no -o'),
    (2, 'export arm.json --to payload --flange tool0', 'name it with --urdf'),
    (1, 'calibrate good.mcap good.mcap --mass 2 --urdf arm.urdf',
     'named as the recording without and with'),
    (2, 'calibrate good.mcap rough.mcap --mass -2 --urdf arm.urdf', 'not a number above 0'),
    (2, 'calibrate good.mcap rough.mcap --mass 2 --urdf arm.urdf --com 0 0',
     'expected 3 arguments'),
    (1, 'calibrate good.mcap rough.mcap --mass 2', 'name a file with --urdf'),
    # Another recording as the output would be overwritten.
    (2, 'fit good.mcap -o rough.mcap', 'rough.mcap does not end in .json'),
    (2, 'update good.mcap --model arm.json -o rough.mcap', 'rough.mcap does not end in .json'),
    (2, 'export arm.json --to urdf --urdf arm.urdf -o rough.mcap', 'rough.mcap does not end as'),
    (2, 'calibrate good.mcap', 'name LOADED and --mass'),
    (2, 'calibrate good.mcap rough.mcap --mass 2 --model arm.json', 'name LOADED and --mass'),
    (2, 'calibrate good.mcap --goals /goals', '--goals needs one recording and --model'),
    (2, 'calibrate good.mcap rough.mcap --goals /goals --model arm.json',
     'neither LOADED nor --mass'),
    (1, 'calibrate good.mcap --goals /nothing --model arm.json', 'no topic /nothing'),
    (1, 'check good.mcap --urdf none.urdf', 'cannot read URDF'),
    (1, 'check good.mcap', 'name a file with --urdf'),
    (1, 'check good.mcap --urdf other.urdf', 'has no joint'),
    (1, 'workbench good.mcap none.mcap --no-browser', 'no such recording: none.mcap'),
    (1, 'workbench good.mcap --model none.json --port 0 --no-browser', 'none.json'),
    (1, 'workbench good.mcap --host 256.1.1.1 --port 0 --no-browser', 'cannot serve on 256.1.1.1')]


@pytest.mark.parametrize(('status', 'call', 'message'), REFUSALS, ids=[x[1] for x in REFUSALS])
def test_errors_are_one_line_and_write_nothing(here, capsys, status, call, message):
    before = {path.name: path.read_bytes() for path in here.iterdir()}
    line = refused(capsys, *shlex.split(call), status=status)
    assert message in line and 'internal error' not in line
    assert {path.name: path.read_bytes() for path in here.iterdir()} == before


def test_a_page_shows_why_a_check_was_refused(here, tmp_path, capsys):
    page = tmp_path / 'r.html'
    message = refused(capsys, 'check', 'good.mcap', '--urdf', 'none.urdf', '--html', page)
    assert message.split(': ', 1)[1] in page.read_text()


def test_a_recording_may_have_the_name_of_an_effect(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    bag('coulomb_friction')
    assert main(['info', 'coulomb_friction']) == 0


@pytest.mark.parametrize('call', ['info good.mcap', 'compare good.mcap --model arm.json'])
def test_a_joint_is_a_name_or_a_number_in_every_verb(here, capsys, call):
    results = []
    for joints in ('2,1', 'elbow,shoulder'):
        document = run_json(capsys, *call.split(), '--joints', joints)
        results.append(document.get('recordings', [document])[0]['joints'])
    assert list(results[0]) == ['elbow', 'shoulder'] and results[0] == results[1]


def test_effort_scale_by_joint_number(here, capsys):
    facts = run_json(capsys, 'info', 'good.mcap', '--effort-scale', '2=-1')['recordings'][0]
    assert facts['effort_scale'] == {'elbow': -1.0}
    # Names take precedence over numbers.
    assert joint_named('2', ('2', '1')) == '2'
    assert joint_named('2', ('a', 'b')) == 'b'
    assert joint_named('0', ('a', 'b')) is None and joint_named('x', ('a',)) is None


@pytest.mark.parametrize('what', ['q', 'tau'])
def test_values_out_of_range_are_dropped(tmp_path, capsys, what):
    corrupted = {'q': Q.copy(), 'tau': TAU.copy()}
    corrupted[what][100, 0] = 1e300
    path = bag(tmp_path / 'x.mcap', **corrupted)
    whole = read_bag(path)
    assert len(whole.samples) == 499
    assert whole.report.dropped == {'position or effort missing or not finite': 1}
    assert np.abs(whole.samples.tau).max() < 20
    assert main(['fit', path, '--json']) == 0
    output = capsys.readouterr()
    assert 'RuntimeWarning' not in output.err
    assert json.loads(output.out)['joints']['shoulder']['rmse'] < 0.1


def test_efforts_out_of_range_throughout_are_refused(tmp_path, capsys):
    path = bag(tmp_path / 'x.mcap', tau=1e300 * TAU)
    assert 'beyond 1e+09 in 500 of 500' in refused(capsys, 'info', path)


def test_gaps_are_noted(tmp_path):
    t = T.copy()
    t[250:] += 1000.0
    path = bag(tmp_path / 'x.mcap', t=t)
    assert any(note.startswith('a gap of 1000 s, 49.8 s after')
               for note in read_bag(path).report.notes)
    # Poses half a minute apart do not count as gaps.
    slow = bag(tmp_path / 'y.mcap', t=30.0 * np.arange(500.0))
    assert not any('gap' in note for note in read_bag(slow).report.notes)
