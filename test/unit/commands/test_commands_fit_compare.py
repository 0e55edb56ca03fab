"""`fit` and `compare`, from bag to errors, on an arm with an analytic torque."""

from dataclasses import replace
import json
import re

from bench.shared.command_line import run_json
from bench.shared.rough_links import JOINTS, NOISE, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import pytest

def bag(path, samples):
    write_bag(path, [joint_states(samples)])
    return str(path)


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    train, later = (two_links(seed, 1200, rough=0.0) for seed in (1, 2))
    fast = replace(later, t=later.t / 8.0, qd=later.qd * 8.0)
    return {'train': bag(folder / 'train.mcap', train), 'later': bag(folder / 'later.mcap', later),
            'fast': bag(folder / 'fast.mcap', fast)}


@pytest.fixture(scope='module')
def model(bags, tmp_path_factory):
    path = tmp_path_factory.mktemp('models') / 'arm.json'
    assert main(['fit', bags['train'], '--formulation', 'potential', '-o', str(path)]) == 0
    return str(path)


def test_fit_shows_and_reports_equations_and_solver(bags, model, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(terminal, '_PROGRESS_DELAY', 0.0)
    assert main(['fit', bags['train'], '--formulation', 'potential', '--json',
                 str(tmp_path / 'fit.json')]) == 0
    out = capsys.readouterr()
    output = ' '.join(out.out.split())
    assert re.search(r'shoulder = (10\.0|9\.9)\d s1 ', output)
    assert 'ADMM: 1 L1 problem' in output and 'relative gap' in output
    assert '1200 of 1200 samples pass the slow-motion gate' in output and 'not saved' in output
    assert '... fit' in out.err
    result = json.loads((tmp_path / 'fit.json').read_text())
    assert result['converged'] and result['report']['solver'][0]['gap'] < 1e-6
    assert result['bags'][0]['name'] == 'train.mcap' and result['gate']['kept'] == 301
    for joint in JOINTS:
        assert result['joints'][joint]['rmse'] == pytest.approx(NOISE, rel=0.15)
        assert result['joints'][joint]['features'] == {'shoulder': 3, 'elbow': 2}[joint]
    kept = load_model(model).provenance
    assert kept['bags'] == result['bags'] and kept['holdout'] is None


def test_the_error_on_held_out_data_equals_the_noise(bags, model, capsys):
    result = run_json(capsys, 'compare', bags['later'], '--model', model)
    assert result['fitted_to'] == []
    for joint in JOINTS:
        figures = result['joints'][joint]
        assert {'n', 'rmse', 'nrmse', 'std', 'max_abs', 'where'} <= set(figures)
        assert figures['n'] == 301
        assert figures['rmse'] == pytest.approx(NOISE, rel=0.15)
    # Fast samples are compared with all samples.
    result = run_json(capsys, 'compare', bags['fast'], '--model', model, '--all-samples')
    assert result['gate'] == {'total': 1200, 'kept': 1200, 'dropped': {}, 'all_samples': True}
    # A comparison with fitted data gives a warning.
    assert main(['compare', bags['train'], '--model', model]) == 0
    out = capsys.readouterr()
    assert 'the model was fitted to train.mcap' in out.err
    assert 'worst joint: ' in out.out


def test_held_out_errors_of_fit_and_compare_agree(bags, capsys, tmp_path):
    path = tmp_path / 'm.json'
    fitted = run_json(capsys, 'fit', bags['train'], '--holdout', '0.25', '-o', path)
    assert fitted['holdout']['n_samples'] == pytest.approx(75, abs=4)
    assert fitted['report']['n_samples'] <= 900
    compared = run_json(capsys, 'compare', bags['train'], '--model', path, '--holdout')
    for joint in JOINTS:
        held_out = fitted['joints'][joint]['held_out']
        assert compared['joints'][joint]['rmse'] == pytest.approx(held_out['rmse'], rel=1e-9)
        assert compared['joints'][joint]['n'] == fitted['holdout']['n_samples']


def test_a_named_gate_counts_more_than_that_of_the_fit(bags, capsys, tmp_path):
    path = tmp_path / 'm.json'
    run_json(capsys, 'fit', bags['train'], '--holdout', '0.25', '--rate', '2', '-o', path)
    held_out = 'compare', bags['train'], '--model', path, '--holdout'
    assert run_json(capsys, *held_out)['gate']['rate_hz'] == 2.0
    # The default of the option is a choice too.
    assert run_json(capsys, *held_out, '--rate', '5')['gate']['rate_hz'] == 5.0


@pytest.fixture(scope='module')
def scaled(bags, tmp_path_factory):
    path = str(tmp_path_factory.mktemp('scaled') / 'm.json')
    assert main(['fit', bags['train'], '--joints', 'elbow,shoulder', '--effort-scale',
                 'elbow=-2', '--formulation', 'potential', '-o', path]) == 0
    return path


def test_a_different_effort_scale_than_in_the_fit_gives_a_warning(bags, model, scaled, capsys,
                                                                  tmp_path):
    scale = ['--effort-scale', 'elbow=-2']

    def warnings(*argv):
        capsys.readouterr()
        assert main([*argv]) == 0
        return [line for line in capsys.readouterr().err.splitlines() if 'scale' in line]

    later, out = bags['later'], str(tmp_path / 'out.mcap')
    for verb in (['compare', later, '--json'], ['replay', later, '-o', out],
                 ['diagnose', later, '--effects', 'torque_offset'],
                 ['add', 'torque_offset', later, '--dry-run']):
        (line,) = warnings(*verb, '--model', scaled)
        assert line == ('warning: the model was fitted with another effort scale of elbow: '
                        'unless the driver has changed, use --effort-scale elbow=-2')
    assert not warnings('compare', later, '--model', scaled, *scale)
    assert not warnings('compare', later, '--model', model)
    (line,) = warnings('compare', later, '--model', model, *scale)
    assert '--effort-scale elbow=1' in line
