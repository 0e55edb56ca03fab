"""`update`: a new payload from ten seconds of motion, on the command line."""

import json
from pathlib import Path
from types import SimpleNamespace

from bench.shared.command_line import refused, run_json
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.update_report import details
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.simulation import arms, motions
import numpy as np
import pytest

URDF = str(Path(__file__).resolve().parents[3] / 'bags' / 'iiwa7.urdf')
COM = (0.02, 0.03, 0.1)
LATER = motions.eq17(start=100.0).q
FRICTION = ('--hidden', 'coulomb_friction:4=0.6')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with recordings of the bare and the loaded arm, smooth and rough."""
    root = tmp_path_factory.mktemp('update')
    load = ['--payload', '2', '--payload-com', *map(str, COM), '--start', '100']
    for name, *more in (
            ('bare', '--seed', '1'),
            ('bare_rough', '--seed', '1', '--rate', '2.5', *FRICTION),
            ('tool', '--seed', '2', '--samples', '50', *load),
            ('tool_rough', '--seed', '2', '--samples', '100', *load, *FRICTION),
            ('few', '--seed', '2', '--samples', '8', *load)):
        assert main(['synth', '--noise', '0.1', *more, '-o', str(root / f'{name}.mcap')]) == 0
    assert main(['fit', str(root / 'bare.mcap'), '--formulation', 'chain',
                 '-o', str(root / 'arm.json')]) == 0
    return root


@pytest.fixture
def model(folder, tmp_path):
    path = tmp_path / 'arm.json'
    path.write_bytes((folder / 'arm.json').read_bytes())
    return path


def worst(model) -> float:
    """Return the RMSE in N·m of the worst joint with the tool, against noise-free gravity."""
    arm = arms.with_payload(arms.iiwa7(), arms.Payload(2.0, COM))
    error = model.predict(LATER) - arms.gravity_torque(arm, LATER)
    return float(np.sqrt((error ** 2).mean(axis=0)).max())


def test_a_model_with_axes_estimates_mass_without_a_description(folder, tmp_path, capsys):
    path, new, few = tmp_path / 'axes.json', tmp_path / 'new.json', tmp_path / 'few.mcap'
    # A recording may list the joints in any order; the model uses the order of the arm.
    names = [f'iiwa_joint_{k}' for k in (4, 2, 1, 3, 7, 6, 5)]
    capsys.readouterr()
    assert main(['fit', str(folder / 'bare.mcap'), '--urdf', URDF, '-o', str(path), '--joints',
                 ','.join(names), '--json', str(tmp_path / 'report.json')]) == 0
    assert 'axes from the URDF' in capsys.readouterr().out
    report, model = json.loads((tmp_path / 'report.json').read_text())['report'], load_model(path)
    assert report['formulation'] == 'chain' and report['known_axes']
    assert model.provenance['options']['known_axes'] and model.joints == tuple(sorted(names))
    update = ('update', folder / 'tool.mcap', '--model', path, '-o', new)
    result = run_json(capsys, *update)
    assert result['payload']['mass']['value'] == pytest.approx(2.0, abs=0.05)
    assert result['description']['source'] and not any('few' in w for w in result['warnings'])
    assert run_json(capsys, *update, '--urdf', 'none')['payload'] is None
    assert main(['cut', str(folder / 'tool.mcap'), '-o', str(few), '--to', '3']) == 0
    result = run_json(capsys, 'update', few, '--model', path, '-o', new)
    assert any(w.startswith('16 slow samples are few') for w in result['warnings'])
    assert 'potential does not use a robot description' in refused(
        capsys, 'fit', folder / 'bare.mcap', '--urdf', URDF, '--formulation', 'potential')


def test_text_and_undo(folder, model, capsys):
    before = load_model(model)
    assert main(['update', str(folder / 'tool.mcap'), '--model', str(model), '--urdf', URDF]) == 0
    text = capsys.readouterr().out
    assert 'mass +' in text and 'in the frame of iiwa_link_7' in text
    assert 'torque of the payload, N·m (50 samples)' in text
    update = load_model(model).provenance['updates'][-1]
    assert update['bags'][0]['name'] == 'tool.mcap' and update['when'].startswith('20')
    assert main(['update', '--undo', '--model', str(model)]) == 0
    back = load_model(model)
    np.testing.assert_array_equal(back.predict(LATER), before.predict(LATER))
    assert [step.action for step in back.history] == ['updated', 'removed']
    assert 'updates' not in back.provenance
    assert 'undone already' in refused(capsys, 'update', '--undo', '--model', model)


def test_an_update_that_increases_the_error_warns(model):
    arm = load_model(model)
    q = LATER[:60]
    tau = arm.predict(q) + 0.1 * np.random.default_rng(0).standard_normal(q.shape)
    samples = JointSamples.single_run(arm.joints, np.arange(60) / 5.0, q, 0 * q, tau)
    step = SimpleNamespace(model=arm, payload=None, is_payload=True, changed=(),
                           change=SimpleNamespace(log_evidence=0.0, lasso=None))
    sigma = np.full(7, 0.1)
    for rise, count in ((0.05, 0), (0.3, 1)):
        report = details(arm, step, samples, sigma + rise * np.eye(7)[2], sigma)
        worse = [line for line in report.warnings if 'no change of masses' in line]
        assert len(worse) == count and all(arm.joints[2] in line for line in worse)


def test_effects_are_kept_unchanged(folder, tmp_path, capsys):
    model, new = tmp_path / 'rough.json', tmp_path / 'new.json'
    assert main(['fit', str(folder / 'bare_rough.mcap'), '--formulation', 'chain', '--effects',
                 'coulomb_friction:iiwa_joint_4', '-o', str(model)]) == 0
    result = run_json(capsys, 'update', folder / 'tool_rough.mcap', '--model', model, '-o', new,
                      '--urdf', URDF)
    assert result['effects'] == ['coulomb_friction:iiwa_joint_4']
    old, changed = load_model(model), load_model(new)
    assert changed.applied.effects == old.applied.effects
    assert worst(changed) <= 0.15
    assert result['payload']['mass']['value'] == pytest.approx(2.0, rel=0.03)
    # Both changes can be undone, the last one first.
    assert [step.action for step in changed.history] == ['added', 'updated']
    assert main(['update', '--undo', '--model', str(new)]) == 0
    assert 'the addition of coulomb_friction:iiwa_joint_4' in refused(
        capsys, 'update', '--undo', '--model', new)
    assert main(['add', '--undo', '--model', str(new)]) == 0


def test_an_addition_before_a_payload_change_is_not_undone(folder, tmp_path, capsys):
    # A model updated by the node, without a history step of the update.
    from dataclasses import replace
    from gravity_comp_ros.models.history import with_step
    from gravity_comp_ros.models.model_file import save_model
    old = load_model(folder / 'arm.json')
    added = with_step(old, old, ('coulomb_friction:iiwa_joint_4',), 'now', {}, {})
    save_model(tmp_path / 'm.json', replace(added, provenance={
        **added.provenance, 'updates': [{'n_samples': 50}]}))
    message = refused(capsys, 'add', '--undo', '--model', tmp_path / 'm.json')
    assert 'the payload changed after coulomb_friction:iiwa_joint_4 had been added' in message
