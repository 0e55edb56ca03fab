"""Output of verbs: tables of any width, next commands, no input overwritten; and `info`."""

import json
import shlex

from bench.shared.command_line import refused
from bench.shared.rough_links import two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.models.model_file import load_model
import numpy as np
import pytest
from rich.cells import cell_len

# Arguments of each verb; BAG, MODEL, TABLE, OLD and ARM.urdf are replaced by files.
CALLS = {
    'synth': ['-o', 'OUT.mcap', '--arm', 'ARM.urdf'],
    'convert': ['TABLE', '-o', 'OUT.mcap'],
    'info': ['BAG'],
    'fit': ['BAG', '-o', 'OUT.json', '--urdf', 'ARM.urdf'],
    'compare': ['BAG', '--model', 'MODEL', '--previous', 'OLD', '--html', 'OUT.html'],
    'diagnose': ['BAG', '--model', 'MODEL', '--html', 'OUT.html'],
    'add': ['coulomb_friction', 'BAG', '--model', 'MODEL'],
    'update': ['BAG', '--model', 'MODEL', '-o', 'OUT.json', '--urdf', 'ARM.urdf'],
    'replay': ['BAG', '--model', 'MODEL', '-o', 'OUT.mcap']}
SOURCES = {'BAG', 'MODEL', 'TABLE', 'OLD', 'ARM.urdf'}
PLACES = [(verb, place) for verb, call in CALLS.items() for place, word in enumerate(call)
          if word in SOURCES]


def call(folder, verb, replaced):
    """Return a call of the verb; `replaced` maps argument positions to file names."""
    arguments = [replaced.get(place, word) for place, word in enumerate(CALLS[verb])]
    return [verb, *(str(folder / w) if w in SOURCES or 'OUT' in w else w for w in arguments)]


@pytest.mark.parametrize(('verb', 'place', 'how'), [
    *((*place, 'the file') for place in PLACES),
    *((*PLACES[0], how) for how in ('hard link', 'symbolic link'))])
def test_an_input_is_never_overwritten(tmp_path, capsys, verb, place, how):
    source = tmp_path / 'source.json'
    source.write_text('precious')
    target = source
    if how != 'the file':
        target = tmp_path / 'other.json'
        (target.hardlink_to if 'hard' in how else target.symlink_to)(source)
    argv = call(tmp_path, verb, {place: str(source)})
    assert 'would be overwritten' in refused(capsys, *argv, '--json', target)
    assert source.read_text() == 'precious'
    assert sorted(tmp_path.iterdir()) == sorted({source, target})


@pytest.mark.parametrize('verb', [verb for verb, call in CALLS.items() if 'OUT.json' in call])
def test_two_outputs_are_two_files(tmp_path, capsys, verb):
    argv = call(tmp_path, verb, {})
    assert 'both name' in refused(capsys, *argv, '--json', tmp_path / 'OUT.json')
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('verb', CALLS)
def test_a_missing_folder_is_reported_before_the_work(tmp_path, capsys, verb):
    # The inputs are missing as well: a verb that reads them first would report them instead.
    assert 'there is no folder' in refused(capsys, *call(tmp_path, verb, {}), '--json',
                                           tmp_path / 'nowhere' / 'x.json')


def test_many_effects_are_no_file_name(tmp_path, capsys):
    effects = ','.join(f'torque_offset:joint_{k}' for k in range(40))
    assert 'no.json' in refused(capsys, 'add', effects, 'no.mcap', '--model', tmp_path / 'no.json')


def test_an_output_inside_the_folder_of_the_recording_is_refused(tmp_path, capsys):
    bag = tmp_path / 'bag'
    bag.mkdir()
    assert 'is inside the folder' in refused(
        capsys, 'info', bag, '--json', bag / 'x.json')


def test_a_read_only_model_is_not_changed(tmp_path, capsys):
    model = tmp_path / 'arm.json'
    model.write_text('{}')
    model.chmod(0o444)
    for argv in (['fit', 'no.mcap', '-o', model], ['add', '--undo', '--model', model],
                 ['add', 'torque_offset', 'no.mcap', '--model', model],
                 ['update', '--undo', '--model', model]):
        assert 'is read-only' in refused(capsys, *argv)
    assert model.read_text() == '{}'


def test_the_summary_of_a_fleet_is_not_among_its_models(tmp_path, capsys):
    pytest.importorskip('distributed')
    (tmp_path / 'robots' / 'one').mkdir(parents=True)
    (tmp_path / 'robots' / 'one' / 'a.mcap').write_bytes(b'')
    models = tmp_path / 'models'
    fleet = ('fleet', 'fit', tmp_path / 'robots', '-o', models, '--json', models / 'one.json')
    assert 'no folder' in refused(capsys, *fleet)
    models.mkdir()
    assert 'is inside the folder' in refused(capsys, *fleet)
    assert not (models / 'one.json').exists()


@pytest.mark.parametrize('width', [20, 34, 50, 90, None])
def test_no_cell_and_no_word_of_a_heading_is_cut(width, monkeypatch, capsys):
    monkeypatch.delenv('COLUMNS', raising=False)
    if width is not None:
        monkeypatch.setenv('COLUMNS', str(width))
    name, text = 'very_long_name_' * 2, 'F_c = 0.83 N·m (0.77 to 0.88), F_v = 1.2 N·m s/rad'
    terminal.show(TextTable(['joint', 'RMSE in training', 'coefficients', 'x'],
                            [[name, '1.25', text, '-0.5']]))
    output = capsys.readouterr().out
    for word in (name, '1.25', '-0.5', 'RMSE', 'training', 'coefficients', *text.split()):
        assert word in output
    if width is None:  # in a pipe each joint has one row
        assert any(name in line and text in line for line in output.splitlines())
    else:
        assert max(cell_len(line.rstrip()) for line in output.splitlines()) <= max(width, 79)


def test_a_command_is_never_broken(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '40')
    command = 'gravity_comp fit ' + ' '.join(f'run_{n}.mcap' for n in range(20))
    terminal.show(terminal.command(command))
    assert capsys.readouterr().out == f'  {command}\n'


def test_a_name_neither_formats_nor_controls_the_terminal(capsys):
    name = '[red]\x1b[31mevil\n'
    terminal.show(TextTable(['joint'], [[name]]), terminal.command(name), name)
    terminal.note(name)
    printed = ''.join(capsys.readouterr())
    assert printed.count('[red]\\x1b[31mevil') == 4 and '\x1b' not in printed


@pytest.mark.parametrize('delay, lines', [
    (3600.0, ''), (0.0, '... read [red]a\n... fit\n')])
def test_long_work_prints_each_stage_once_in_a_log(capsys, monkeypatch, delay, lines):
    monkeypatch.setattr(terminal, '_PROGRESS_DELAY', delay)
    with terminal.progress() as report:
        for stage, fraction in (('read [red]a', 0.0), ('read [red]a', 0.5), ('fit', 0.6)):
            report(stage, fraction)
    assert capsys.readouterr().err == lines


@pytest.fixture
def table(tmp_path, monkeypatch):
    """Return a CSV of two joints with friction on the second, efforts in mN·m and reversed."""
    monkeypatch.chdir(tmp_path)
    links = two_links(rough=0.0)
    tau = links.tau + [0.0, 0.8] * np.tanh(links.qd / 0.005)
    path = tmp_path / 'my log.csv'
    np.savetxt(path, np.column_stack([links.t, links.q, links.qd, -1000 * tau]), delimiter=',',
               comments='', header='t,q_1,q_2,qd_1,qd_2,tau_1,tau_2')
    return path


def printed(capsys, argv):
    """Run a call and return the printed commands."""
    capsys.readouterr()
    assert main(argv) == 0
    return [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()
            if line.startswith('  gravity_comp ')]


def test_from_a_table_to_an_effect_by_the_printed_commands_alone(table, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '60')   # commands are not wrapped
    (info,) = printed(capsys, ['convert', 'my log.csv', '-o', 'my run.mcap'])
    assert info == ['info', 'my run.mcap']
    (fit,) = printed(capsys, [*info, '--effort-unit', 'mNm', '--effort-scale', '1=-1,2=-1'])
    (diagnose,) = printed(capsys, fit)
    (add,) = printed(capsys, diagnose)
    assert add[:2] == ['add', 'coulomb_friction:joint_2']
    undo, again = printed(capsys, add)
    model = load_model('arm.json')
    friction = model.applied.effects[0].coefficients['F_c'].value
    assert friction == pytest.approx(0.8, abs=0.05)
    assert printed(capsys, undo) == [] and not load_model('arm.json').applied.effects
    assert again == diagnose


@pytest.fixture(scope='module')
def slow(tmp_path_factory):
    path = tmp_path_factory.mktemp('info') / 'slow.mcap'
    assert main(['synth', '--noise', '0.1', '-o', str(path)]) == 0
    return path


def info(capsys, *arguments):
    capsys.readouterr()
    assert main(['info', *map(str, arguments)]) == 0
    return capsys.readouterr().out


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
