"""`add`, `add --undo` and `fit --effects`, on two links with an analytic torque."""


from bench.shared.command_line import refused, run_json
from bench.shared.rough_links import COULOMB, JOINTS, NOISE, OFFSET, two_links, VISCOUS
from gravity_comp_ros.cli import main
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.models.applied_effects import AppliedEffect, Value
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    runs = {'one': two_links(1), 'two': two_links(2), 'later': two_links(3),
            'short': two_links(4, count=40), 'one_way': two_links(5, one_way=True),
            'other': two_links(6, names=('a', 'b'))}
    for name, samples in runs.items():
        write_bag(folder / f'{name}.mcap', [joint_states(samples)])
    return {name: str(folder / f'{name}.mcap') for name in runs}


@pytest.fixture(scope='module')
def fitted(bags, tmp_path_factory):
    path = tmp_path_factory.mktemp('models') / 'arm.json'
    assert main(['fit', bags['one'], bags['two'], '-o', str(path)]) == 0
    return path.read_bytes()


@pytest.fixture
def model(fitted, tmp_path):
    path = tmp_path / 'arm.json'
    path.write_bytes(fitted)
    return path


def add(capsys, effects, model, *bags, **options):
    return run_json(capsys, 'add', effects, '--model', model, *bags, *options.get('more', ()))


def rms(model, samples):
    return np.sqrt(((samples.tau - predict_torque(model, samples)) ** 2).mean(axis=0))


def test_friction_and_offset_are_estimated_correctly(bags, model, capsys):
    result = add(capsys, 'coulomb_friction:shoulder,viscous_friction:shoulder,'
                 'torque_offset:elbow', model, bags['one'], bags['two'])
    effects = {effect['target']: effect['coefficients'] for effect in result['effects']}
    for target, symbol, truth, unit, width in (
            ('coulomb_friction:shoulder', 'F_c', COULOMB, 'N·m', 0.35),
            ('viscous_friction:shoulder', 'F_v', VISCOUS, 'N·m·s/rad', 0.35),
            ('torque_offset:elbow', 'b', OFFSET, 'N·m', 0.8)):
        value = effects[target][symbol]
        assert value['unit'] == unit
        low, high = value['ci95']
        # The base tilt of a chain is free and nearly collinear with the offset of the elbow.
        assert low < truth < high and high - low < width * truth
    for joint in JOINTS:
        assert result['held_out'][joint]['rmse_after'] < 1.15 * NOISE
    # Gravity absorbed most of the offset by a feature c2, but no friction.
    assert result['held_out']['shoulder']['rmse_before'] > 0.5
    assert result['held_out']['elbow']['rmse_before'] > 1.5 * NOISE
    assert result['p'] < 1e-3 and not result['warnings'] and result['written']
    # Gravity itself is accurate on a held-out recording.
    changed, later = load_model(model), two_links(3)
    truth = np.column_stack([10.0 * np.sin(later.q[:, 0]), np.zeros(len(later))]) \
        + 4.0 * np.sin(later.q.sum(axis=1))[:, None]
    assert np.abs(changed.predict(later.q) - truth).max() < 0.1
    assert (rms(changed, later) < 1.2 * NOISE).all()


def test_without_a_joint_an_effect_is_added_where_identifiable(bags, model, capsys):
    result = add(capsys, 'coulomb_friction', model, bags['one'], bags['two'])
    assert 'coulomb_friction:shoulder' in result['added']
    # The elbow has no friction: the effect is omitted if negative, and near zero otherwise.
    elbow = [e for e in result['effects'] if e['joint'] == 'elbow']
    assert 'coulomb_friction:elbow' in result['left_out'] or \
        abs(elbow[0]['coefficients']['F_c']['value']) < 0.03


def test_undo_restores_the_model_bit_by_bit(bags, model, capsys):
    start = load_model(model)
    add(capsys, 'coulomb_friction:shoulder', model, bags['one'])
    middle = load_model(model)
    add(capsys, 'torque_offset:elbow', model, bags['one'])
    kept = model.read_bytes()
    assert 'in the model already' in refused(capsys, 'add', 'torque_offset:elbow', '--model',
                                             model, bags['one'])
    assert model.read_bytes() == kept
    done = run_json(capsys, 'add', '--undo', '--model', model)
    assert done['removed'] == ['torque_offset:elbow']
    assert done['effects'] == ['coulomb_friction:shoulder']
    back = load_model(model)
    assert back.applied.effects == middle.applied.effects
    np.testing.assert_array_equal(back.energy.weights, middle.energy.weights)
    assert main(['add', '--undo', '--model', str(model)]) == 0
    back = load_model(model)
    np.testing.assert_array_equal(back.energy.weights, start.energy.weights)
    np.testing.assert_array_equal(back.noise, start.noise)
    assert [(step.action, step.effects) for step in back.history] == [
        ('added', ('coulomb_friction:shoulder',)), ('added', ('torque_offset:elbow',)),
        ('removed', ('torque_offset:elbow',)), ('removed', ('coulomb_friction:shoulder',))]
    kept = model.read_bytes()
    assert 'no addition to undo' in refused(capsys, 'add', '--undo', '--model', model)
    assert model.read_bytes() == kept


def test_an_unnecessary_effect_is_added_with_a_warning(bags, model, capsys):
    assert main(['add', 'viscous_friction:elbow', '--model', str(model), bags['one']]) == 0
    out = capsys.readouterr()
    assert 'too small for a finding' in out.err
    assert 'added viscous_friction:elbow' in out.out


def test_a_dry_run_writes_nothing(bags, model, fitted, capsys):
    result = add(capsys, 'coulomb_friction:shoulder', model, bags['one'], more=['--dry-run'])
    assert result['added'] and not result['written']
    assert model.read_bytes() == fitted


def test_held_out_data_is_never_fitted(bags, tmp_path, capsys):
    path, both = tmp_path / 'm.json', (bags['one'], bags['two'])
    run_json(capsys, 'fit', *both, '--all-samples', '--holdout', '-o', path)
    compared = run_json(capsys, 'compare', *both, '--model', path, '--holdout')
    before = compared['joints']
    # As in the fit, all samples are compared.
    assert compared['gate']['all_samples'] and before['shoulder']['n'] == 1200
    result = add(capsys, 'coulomb_friction:shoulder', path, *both)
    # The second bag was held out, and stays so.
    assert result['n_samples'] == 1200
    after = run_json(capsys, 'compare', *both, '--model', path, '--holdout')['joints']
    assert after['shoulder']['rmse'] < 0.6 * before['shoulder']['rmse']
    diagnosed = run_json(capsys, 'diagnose', *both, '--model', path, '--effects',
                         'viscous_friction')
    assert diagnosed['data']['n_samples'] == 1200


def test_the_samples_are_those_of_the_gate_of_the_fit(bags, tmp_path, capsys):
    path = tmp_path / 'm.json'
    run_json(capsys, 'fit', bags['one'], '--max-speed', '0.2', '--rate', '3', '-o', path)
    for more, expected in (([], (0.2, 3.0)), (['--max-speed', '0.1'], (0.1, 5.0))):
        gate = add(capsys, 'coulomb_friction:shoulder', path, bags['one'],
                   more=[*more, '--dry-run'])['gate']
        assert (gate['max_speed'], gate['rate_hz']) == expected


def test_an_ambiguous_effect_is_added_and_reported_as_ambiguous(bags, tmp_path, capsys):
    path = tmp_path / 'm.json'
    run_json(capsys, 'fit', bags['one_way'], '-o', path)
    result = add(capsys, 'torque_offset:shoulder', path, bags['one_way'])
    assert result['added'] == ['torque_offset:shoulder']
    assert [(finding['effect'], finding['joint']) for finding in result['ties']] == [
        ('torque_offset', 'shoulder')]
    assert 'coulomb_friction' in result['ties'][0]['rivals'] and result['ties'][0]['settled_by']


def test_an_effect_that_is_not_installed_is_reported(bags, model, capsys):
    loaded = load_model(model)
    strange = AppliedEffect('ghost_torque', 'elbow', {}, {'x': Value(1.0, 'N·m', (0.9, 1.1))})
    applied = type(loaded.applied)((strange,))
    save_model(model, type(loaded)(**{**loaded.__dict__, 'applied': applied}))
    assert main(['compare', bags['later'], '--model', str(model)]) == 1
    err = capsys.readouterr().err.splitlines()[-1]
    assert 'ghost_torque' in err and 'not installed' in err
