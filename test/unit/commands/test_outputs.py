"""No verb overwrites its input, and unwritable outputs are refused before the work."""

from gravity_comp_ros.cli import main
import pytest

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
    assert main([*map(str, argv), '--json', str(target)]) == 1
    output = capsys.readouterr()
    assert 'would be overwritten' in output.err and output.err.count('\n') == 1
    assert source.read_text() == 'precious' and output.out == ''
    assert sorted(tmp_path.iterdir()) == sorted({source, target})


@pytest.mark.parametrize('verb', [verb for verb, call in CALLS.items() if 'OUT.json' in call])
def test_two_outputs_are_two_files(tmp_path, capsys, verb):
    argv = call(tmp_path, verb, {})
    assert main([*argv, '--json', str(tmp_path / 'OUT.json')]) == 1
    assert 'both name' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('verb', CALLS)
def test_a_missing_folder_is_reported_before_the_work(tmp_path, capsys, verb):
    # The inputs are missing as well: a verb that reads them first would report them instead.
    assert main([*call(tmp_path, verb, {}), '--json', str(tmp_path / 'nowhere' / 'x.json')]) == 1
    error = capsys.readouterr().err
    assert 'there is no folder' in error and error.count('\n') == 1


def test_many_effects_are_no_file_name(tmp_path, capsys):
    effects = ','.join(f'torque_offset:joint_{k}' for k in range(40))
    assert main(['add', effects, 'no.mcap', '--model', str(tmp_path / 'no.json')]) == 1
    assert 'no.json' in capsys.readouterr().err


def test_an_output_inside_the_folder_of_the_recording_is_refused(tmp_path, capsys):
    bag = tmp_path / 'bag'
    bag.mkdir()
    assert main(['info', str(bag), '--json', str(bag / 'x.json')]) == 1
    assert 'inside the folder of the recording' in capsys.readouterr().err


def test_a_read_only_model_is_not_changed(tmp_path, capsys):
    model = tmp_path / 'arm.json'
    model.write_text('{}')
    model.chmod(0o444)
    for argv in (['fit', 'no.mcap', '-o', model], ['add', '--undo', '--model', model],
                 ['add', 'torque_offset', 'no.mcap', '--model', model],
                 ['update', '--undo', '--model', model]):
        assert main([*map(str, argv)]) == 1
        assert 'is read-only' in capsys.readouterr().err
    assert model.read_text() == '{}'


def test_the_summary_of_a_fleet_replaces_no_model(tmp_path, capsys):
    pytest.importorskip('distributed')
    (tmp_path / 'robots' / 'one').mkdir(parents=True)
    (tmp_path / 'robots' / 'one' / 'a.mcap').write_bytes(b'')
    models = tmp_path / 'models'
    assert main(['fleet', 'fit', str(tmp_path / 'robots'), '-o', str(models), '--json',
                 str(models / 'one.json')]) == 1
    assert 'no folder' in capsys.readouterr().err
    models.mkdir()
    assert main(['fleet', 'fit', str(tmp_path / 'robots'), '-o', str(models), '--json',
                 str(models / 'one.json')]) == 1
    assert 'the result file of a robot' in capsys.readouterr().err
    assert not (models / 'one.json').exists()
