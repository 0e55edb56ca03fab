"""Command line: overview, help, usage errors, and reporting of all other errors."""

import os
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

from gravity_comp_ros import __version__, cli
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.printable import printable
from hypothesis import given, settings, strategies as st
import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def verb(monkeypatch):
    """Return a function that makes `gravity_comp fit` run the given function."""
    def install(run):
        monkeypatch.setitem(sys.modules, 'gravity_comp_ros.commands.fit', SimpleNamespace(
            run=run, add_arguments=lambda parser: None, __doc__=''))
    return install


def fails_with(error):
    def run(args):
        raise error
    return run


def test_version_and_overview_of_every_verb(capsys):
    assert cli.main(['--help']) == 0
    output = capsys.readouterr().out
    assert 'not available' not in output
    for name in cli.VERBS:
        assert f'\n  {name} ' in output
    assert cli.main([]) == 2 and 'usage' in capsys.readouterr().err
    assert cli.main(['--version']) == 0
    assert capsys.readouterr().out == f'gravity_comp {__version__}\n'


def test_the_script_is_printed_without_the_module_of_another_verb(monkeypatch, capsys):
    pytest.importorskip('shtab')
    monkeypatch.setitem(sys.modules, 'gravity_comp_ros.commands.synth', None)
    assert cli.main(['completion', 'bash']) == 0
    printed = capsys.readouterr()
    assert '--formulation' in printed.out and 'the options of synth' in printed.err


@pytest.mark.parametrize('name', cli.VERBS)
def test_every_verb_has_help_with_examples(name, capsys):
    assert cli.main([name, '--help']) == 0
    output = capsys.readouterr().out
    assert output.startswith(f'usage: gravity_comp {name}')
    assert f'  gravity_comp {name} ' in output, 'no example'


def test_the_overview_imports_no_numerical_modules():
    calls = [['--version'], ['--help'], ['nonsense']]
    code = ('import sys; from gravity_comp_ros.cli import main\n'
            f'for call in {calls!r}:\n    main(call)\n'
            'print([name for name in ("numpy", "scipy", "rich", "yaml") if name in sys.modules])')
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, timeout=60,
                          capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.endswith('[]\n'), done.stdout


def test_the_help_of_no_verb_imports_scipy():
    code = ('import sys; from gravity_comp_ros.commands import arguments, VERBS; '
            '[arguments.verb_parser(verb).format_help() for verb in VERBS if verb != "completion"]'
            '; sys.exit("scipy" in sys.modules)')
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, timeout=60)
    assert done.returncode == 0


def test_defaults_of_the_gate_are_those_in_the_help(capsys):
    assert cli.main(['fit', '--help']) == 0
    output = ' '.join(capsys.readouterr().out.split())
    assert f'joint speed of a sample (default: {GateOptions().max_speed:g})' in output
    assert f'per second of slow motion (default: {GateOptions().rate_hz:g})' in output


@pytest.mark.parametrize(('typed', 'offered'), [
    ('co', 'convert compare completion'), ('fit --form', '--formulation'),
    ('fit --formulation=', ''), ('fit --formulation pot', 'potential'), ('info --no', '')])
def test_a_shell_completes(tmp_path, capsys, typed, offered):
    pytest.importorskip('shtab')
    assert cli.main(['completion', 'bash']) == 0
    script = tmp_path / 'gravity_comp'
    script.write_text(capsys.readouterr().out)
    arguments = ['gravity_comp', *typed.split()]
    done = subprocess.run(
        ['bash', '-c', f'source {script}; COMP_WORDS=({" ".join(arguments)}); COMP_CWORD='
         f'{len(arguments) - 1}; COMP_LINE="{" ".join(arguments)}"; $(complete -p gravity_comp | '
         'sed "s/.*-F \\([^ ]*\\).*/\\1/"); echo "${COMPREPLY[@]}"'],
        capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == offered.split() or sorted(done.stdout.split()) == sorted(
        offered.split()), (done.stdout, done.stderr)


@pytest.mark.parametrize('error, status, line', [
    (BagError('x.mcap: empty\nof all'), 1, 'gravity_comp fit: x.mcap: empty of all\n'),
    (BagError('joint \x1b[31mred'), 1, 'gravity_comp fit: joint \\x1b[31mred\n'),
    (OSError(28, 'No space left on device', 'm.json'), 1,
     'gravity_comp fit: No space left on device: m.json\n'),
    (PermissionError(13, 'Permission denied', b'm.json'), 1,
     'gravity_comp fit: Permission denied: m.json\n'),
    (MemoryError(), 1, 'gravity_comp fit: not enough memory: use fewer or shorter '
     'recordings\n'),
    (KeyboardInterrupt(), 130, 'gravity_comp fit: interrupted\n'),
    (ZeroDivisionError('oh'), 1, 'gravity_comp fit: internal error, please report it: '
     'ZeroDivisionError: oh (GRAVITY_COMP_DEBUG=1 prints the traceback)\n'),
])
def test_a_failure_is_one_line(verb, capsys, error, status, line):
    verb(fails_with(error))
    assert cli.main(['fit']) == status
    assert capsys.readouterr() == ('', line)


def test_debug_prints_the_traceback(verb, capsys, monkeypatch):
    monkeypatch.setenv('GRAVITY_COMP_DEBUG', '1')
    verb(fails_with(BagError('broken')))
    assert cli.main(['fit']) == 1
    error = capsys.readouterr().err
    assert 'Traceback' in error and error.endswith('gravity_comp fit: broken\n')


def test_a_missing_library_affects_only_the_verb_that_requires_it(tmp_path):
    calls = [['synth', '-o', str(tmp_path / 'a.mcap')], ['fit', '--help'], ['--help']]
    program = ('import sys; sys.modules["pinocchio"] = None; '
               f'from gravity_comp_ros.cli import main; sys.exit(str(list(map(main, {calls!r}))))')
    done = subprocess.run([sys.executable, '-c', program], cwd=ROOT, capture_output=True,
                          text=True, timeout=60)
    message, statuses = done.stderr.splitlines()
    assert 'pip install pin ' in message and statuses == '[1, 0, 0]'


def test_a_closed_pipe_is_quiet():
    done = subprocess.run(f'{sys.executable} -m gravity_comp_ros.cli --help | true', shell=True,
                          cwd=ROOT, capture_output=True, text=True, timeout=60,
                          env={**os.environ, 'PYTHONUNBUFFERED': '1'})
    assert done.stderr == ''


def test_output_to_a_terminal_without_unicode():
    done = subprocess.run([sys.executable, '-m', 'gravity_comp_ros.cli', 'fit', '--help'],
                          cwd=ROOT, capture_output=True, timeout=60,
                          env={**os.environ, 'PYTHONIOENCODING': 'ascii'})
    assert done.returncode == 0, done.stderr
    assert b'N?m per unit' in done.stdout


@settings(max_examples=30)
@given(st.text(max_size=20))
def test_printable_text_contains_no_control_characters(text):
    printed = printable(text)
    assert printed.isprintable()
    assert len(printed.splitlines()) <= 1


def test_printable_keeps_ordinary_names():
    assert printable('Gelenk_1 (Größe ½) 关节') == 'Gelenk_1 (Größe ½) 关节'
    assert printable('a\tb\r\n c') == 'a b c'
    assert printable('\x1b]0;x\x07 \u202e\ud800') == '\\x1b]0;x\\x07 \\u202e\\ud800'
