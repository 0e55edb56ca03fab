"""`diagnose`: text and JSON output, next steps, and untestable effects."""

from argparse import Namespace
from dataclasses import replace
import json
from pathlib import Path
import re
import shlex

from bench.shared.command_line import run_json
from bench.shared.rough_links import COULOMB, JOINTS, NOISE, OFFSET, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.diagnose import next_steps
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, Verdict
from gravity_comp_ros.diagnosis.wording import coefficients, verdict
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import pytest


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with recordings and a model fitted to two of them."""
    folder = tmp_path_factory.mktemp('diagnose')
    runs = {'one': two_links(1), 'two': two_links(2),
            'clean': two_links(3, rough=0.0),
            'one_way': two_links(5, one_way=True), 'short': two_links(4, count=40),
            'other': two_links(6, names=('a', 'b'))}
    for name, samples in runs.items():
        write_bag(folder / f'{name}.mcap', [joint_states(samples)])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(['fit', 'one.mcap', 'two.mcap', '-o', 'arm.json']) == 0
    return folder


@pytest.fixture(autouse=True)
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)


def shown(capsys, *argv):
    assert main(['diagnose', *argv]) == 0
    out = capsys.readouterr()
    return out.out, out.err


def test_json_has_the_documented_keys_and_the_missing_effects(capsys):
    result = run_json(capsys, 'diagnose', 'one.mcap', 'two.mcap', '--model', 'arm.json')
    for finding in result['findings']:
        assert {'joint', 'effect', 'verdict', 'rivals', 'coefficients', 'nrmse_before',
                'nrmse_after', 'base_absorbed', 'runs_better', 'why', 'next_step'} <= set(finding)
        assert finding['verdict'] in tuple(Verdict)
        for value in finding['coefficients'].values():
            assert set(value) == {'value', 'unit', 'ci95'}
            assert value['ci95'][0] <= value['value'] <= value['ci95'][1]
    assert set(result['joints']) == set(JOINTS)
    for report in result['joints'].values():
        assert {'summary', 'noise_floor', 'n_effective'} <= set(report)
        assert 0 < report['n_effective'] <= 2400
    named = {(f['joint'], f['effect']): f for f in result['findings']}
    assert {('shoulder', 'coulomb_friction'), ('shoulder', 'viscous_friction')} <= set(named)
    friction = named['shoulder', 'coulomb_friction']['coefficients']['F_c']
    assert friction['ci95'][0] < COULOMB < friction['ci95'][1]
    assert named['shoulder', 'coulomb_friction']['nrmse_after'] < 0.5 * \
        named['shoulder', 'coulomb_friction']['nrmse_before']
    low, high = named['elbow', 'torque_offset']['coefficients']['b']['ci95']
    assert low < OFFSET < high


def test_text_has_a_sentence_a_table_and_commands(capsys):
    out, _ = shown(capsys, 'one.mcap', 'two.mcap', '--model', 'arm.json')
    lines = out.splitlines()
    assert lines[0].startswith('Missing: ') and '±' in lines[0] and '; ' in lines[0]
    for message in ('recording: 2400 samples', 'missing effects', 'held-out error', 'next step',
                    'not identifiable from this recording', 'coulomb_friction', 'established',
                    'reversals'):
        assert message in out, message
    # The next step is a command that works.
    command = next(line for line in out.splitlines() if 'gravity_comp add' in line)
    argv = shlex.split(command)[1:]
    assert argv[-4:] == ['one.mcap', 'two.mcap', '--model', 'arm.json']
    assert main([*argv, '--dry-run', '--json']) == 0
    added = json.loads(capsys.readouterr().out)
    for joint in JOINTS:
        assert added['held_out'][joint]['rmse_after'] < 1.3 * NOISE


def test_without_a_model_the_next_step_begins_with_a_fit(capsys):
    out, _ = shown(capsys, 'one.mcap', '--effects', 'coulomb_friction,viscous_friction')
    # The file arm.json already exists.
    assert 'gravity_comp fit one.mcap -o arm_2.json' in out
    assert 'coulomb_friction:shoulder' in out and 'torque_offset' not in out


def both(capsys, *argv):
    """Return the text and the content of the JSON file of one run."""
    out, _ = shown(capsys, *argv, '--json', 'both.json')
    return out, json.loads(Path('both.json').read_text())


def test_no_findings_where_nothing_is_missing(capsys):
    out, result = both(capsys, 'clean.mcap')
    assert result['findings'] == []
    assert result['verdict'] == 'Nothing is missing that is detectable in this motion.'
    assert out.startswith('Nothing is missing') and 'next step' not in out


def finding(effect, verdict, alternatives=(), next_step='move it', to_add=()):
    return Finding('shoulder', effect, verdict, alternatives, {}, 0.2, 0.1, 0.0, 1.0, 'why',
                   next_step, to_add=to_add)


def test_the_largest_harmonics_are_shown():
    ripple = {f'a_{k}': Quantity(size, 'N·m', (size - 0.1, size + 0.1))
              for k, size in enumerate((0.1, 0.2, -5.0, 0.3))}
    shown = coefficients(ripple, 2)
    assert re.findall(r'a_\d', shown) == ['a_2', 'a_3'] and shown.endswith(' and 2 more')
    assert coefficients(ripple, 4).startswith('a_0 = ')


def arguments(model):
    return Namespace(bags=[Path('one.mcap')], model=model and Path(model), topic=None, joints=None,
                     effort_scale={}, effort_unit='Nm', rated_torque={}, rename={},
                     position_unit='rad', accept=(), reverse=(), zero={}, differentiate=False)


@pytest.mark.parametrize('model', ['arm.json', None])
def test_accepted_findings_are_added_and_open_ones_are_planned(capsys, folder, model):
    args = arguments(model)
    findings = (finding('coulomb_friction', 'established', to_add=('coulomb_friction:shoulder',)),
                finding('torque_offset', 'ambiguous', ('joint_spring',),
                        to_add=('torque_offset:shoulder', 'joint_spring:shoulder')),
                finding('viscous_friction', 'weak'), finding(None, 'unexplained'))
    terminal.show(*next_steps(args, Diagnosis(findings, {})))
    output = capsys.readouterr().out
    commands = [shlex.split(line)[1:] for line in output.splitlines()
                if line.startswith('  gravity_comp ')]
    verbs = [command[0] for command in commands]
    # The accepted effect with the ambiguous ones, and the motion for the open ones.
    assert verbs == (['add', 'plan'] if model else ['fit', 'add', 'fit', 'plan'])
    add, plan = (next(c for c in commands if c[0] == verb) for verb in ('add', 'plan'))
    assert add[1] == 'coulomb_friction:shoulder,torque_offset:shoulder,joint_spring:shoulder'
    assert plan[-1] == 'motion.yaml'
    assert 'open: 3 findings' in output
    assert 'alternative: joint_spring' in output and 'together they predict the sum' in output
    assert 'no known effect describes it' in output


def test_a_finding_that_is_predicted_with_gravity_stays_open_unless_it_is_established(capsys):
    args = arguments('arm.json')
    own = {'is_predicted': True, 'next_step': 'move it'}
    untestable, established = (replace(finding('joint_spring', verdict), **own)
                               for verdict in ('untestable', 'established'))
    terminal.show(*next_steps(args, Diagnosis((untestable, established), {})))
    output = capsys.readouterr().out
    assert 'open: 1 finding\n' in output and 'gravity_comp add' not in output
    assert verdict(Diagnosis((established,), {})).startswith(
        'Predicted together with gravity already: joint spring on joint shoulder')
    tied = finding('joint_spring', 'ambiguous', ('torque_offset',))
    assert verdict(Diagnosis((tied,), {})) == (
        'Not established (ambiguous): joint spring on joint shoulder; alternative: torque_offset.')
