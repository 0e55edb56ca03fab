"""Public Python API: the loop on two links with known torque."""

from dataclasses import FrozenInstanceError, replace
import json
import pickle
import subprocess
import sys

from bench.shared.rough_links import JOINTS, NOISE, two_links
from bench.shared.serial_arms import planar_2r
import gravity_comp_ros as gc
from gravity_comp_ros import cli
from gravity_comp_ros.api.steps import diagnose_recording
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest

FRICTION = 'coulomb_friction:shoulder'


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    for seed in (1, 2, 3):
        write_bag(folder / f'{seed}.mcap', [joint_states(two_links(seed))])
    return [str(folder / f'{seed}.mcap') for seed in (1, 2, 3)]


@pytest.fixture(scope='module')
def data(bags):
    return gc.read(bags)


@pytest.fixture(scope='module')
def loop(data):
    """Run the loop once; return both parts, model, diagnosis, and the model with effects."""
    train, test = data.split(0.2)
    model = gc.fit(train)
    diagnosis = gc.diagnose(train, model)
    return train, test, model, diagnosis, gc.add_effects(model, train, diagnosis.findings)


def test_optional_dependencies_are_not_imported():
    code = ('import sys, gravity_comp_ros as gc\n'
            'assert not {"numpy", "scipy"} & set(sys.modules)\n'
            'sys.modules.update(dict.fromkeys(["rclpy", "mcap", "rich", "yaml", "pinocchio", '
            '"bokeh", "zstandard", "defusedxml"]))\n'
            'for name in gc.__all__: getattr(gc, name)\n'
            'assert set(gc.__all__) == set(gc._MODULES) <= set(dir(gc))\n'
            'import numpy as np\n'
            'q = np.random.default_rng(0).normal(size=(40, 2))\n'
            'print(gc.fit(gc.Recording.from_arrays(q, np.sin(q), rate=5, qd=0 * q)).joints)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.stdout == "('joint_1', 'joint_2')\n", done.stderr
    with pytest.raises(AttributeError, match='no attribute'):
        gc.nothing_of_the_kind  # noqa: B018


def test_the_loop_finds_the_friction_and_the_error_falls(loop):
    _, test, model, diagnosis, better = loop
    assert any(f.effect == 'coulomb_friction' and f.joint == 'shoulder' for f in diagnosis.found)
    assert all(isinstance(f.verdict, gc.Verdict) for f in diagnosis.findings)
    assert FRICTION in better.effects and not model.effects
    before, after = gc.compare(model, test), gc.compare(better, test)
    assert after.joints['shoulder'].rmse < 1.15 * NOISE < 0.5 * before.joints['shoulder'].rmse
    held = better.held_out['shoulder']
    assert held[1] < 1.15 * NOISE < held[0]
    assert better.undo().effects == ()


def test_functions_and_commands_give_equal_results(loop, bags, tmp_path, capsys):
    """`fit --holdout` and `add` give the same numbers as `fit` and `add_effects`."""
    _, test, model, diagnosis, better = loop
    path = tmp_path / 'arm.json'
    assert cli.main(['fit', *bags, '--holdout', '0.2', '-o', str(path)]) == 0
    same = load_model(path)
    np.testing.assert_array_equal(same.energy.weights, model.gravity.energy.weights)
    assert same.provenance['holdout'] == model.gravity.provenance['holdout']
    assert cli.main(['add', ','.join(better.effects), '--model', str(path), *bags]) == 0
    capsys.readouterr()
    assert cli.main(['compare', *bags, '--model', str(path), '--holdout', '--json']) == 0
    printed = json.loads(capsys.readouterr().out)['joints']
    for name, joint in gc.compare(better, test).joints.items():
        assert printed[name]['rmse'] == pytest.approx(joint.rmse, rel=1e-9)


def test_payload_update_and_undo(data, loop, tmp_path):
    better = loop[-1]
    loaded = two_links(7)
    both = 1.5 * np.sin(loaded.q.sum(axis=1))
    heavier = replace(loaded, tau=loaded.tau + np.column_stack(
        [2.0 * np.sin(loaded.q[:, 0]) + both, both]))
    tool = replace(data, samples=heavier, reports=())
    model = gc.update(better, tool)
    assert model.effects == better.effects
    assert gc.compare(model, tool).joints['elbow'].rmse < 1.2 * NOISE
    assert gc.compare(better, tool).joints['elbow'].rmse > 0.5
    model.save(tmp_path / 'arm.json')
    again = gc.load(tmp_path / 'arm.json')
    np.testing.assert_array_equal(again.predict(heavier.q), model.predict(heavier.q))
    np.testing.assert_allclose(again.undo().predict(heavier.q), better.predict(heavier.q))
    assert str(again) == str(model) and 'before payload' in str(model)


def test_weak_findings_are_not_added(loop):
    train, _, model, diagnosis, _ = loop
    weak = [replace(f, verdict='weak', to_add=()) for f in diagnosis.findings]
    assert gc.add_effects(model, train, weak) is model


def test_results_print_and_show_in_a_notebook(loop):
    train, test, model, diagnosis, better = loop
    for result in (train, test, model, better, diagnosis, gc.compare(better, test)):
        assert len(repr(result)) < 200 and '\n' not in repr(result)
        text, page = str(result), result._repr_html_()
        assert text.splitlines()[0] == result.summary() and len(text.splitlines()) > 2
        assert 'shoulder' in text and '<table>' in page
        with pytest.raises(FrozenInstanceError):
            result.anything = 1
    assert 'established' in str(diagnosis)


def test_names_from_a_file_are_escaped():
    q = np.random.default_rng(0).normal(size=(20, 1))
    odd = gc.Recording.from_arrays(q, q, rate=5, names=['<b>\x1b[31m'])
    assert '<b>' not in odd._repr_html_().split('</p>', 1)[1] and '\x1b' not in str(odd)
    assert 'none of the 20 samples is slow' in str(odd)


def arrays(count=60, seed=0):
    t = 0.2 * np.arange(count)
    q = 0.8 * np.stack([np.sin(0.1 * t + seed), np.cos(0.07 * t + seed)], axis=1)
    return t, q, planar_2r(q)


def test_runs_units_and_scales_of_arrays():
    runs = [arrays(60, 0), arrays(80, 1)]
    t, q, tau = ([run[k] for run in runs] for k in range(3))
    plain = gc.Recording.from_arrays(q, tau, t, names=JOINTS)
    other = gc.Recording.from_arrays(
        [np.degrees(x) for x in q], [x * [-10.0, 2.0] for x in tau], t, names=JOINTS,
        degrees=True, effort_scale={JOINTS[0]: -0.1, JOINTS[1]: 0.5})
    assert plain.n_runs == 2 and len(plain) == 140 and plain.joints == JOINTS
    for field in ('t', 'q', 'qd', 'tau', 'runs'):
        np.testing.assert_allclose(getattr(other.samples, field), getattr(plain.samples, field),
                                   rtol=1e-12, atol=1e-12)
    speed = np.gradient(q[0], t[0], axis=0)
    np.testing.assert_allclose(plain.samples.run(0).qd[3:-3], speed[3:-3], atol=1e-3)
    given = gc.Recording.from_arrays(q, tau, t, qd=[np.zeros_like(x) for x in q])
    assert not given.samples.qd.any()


@pytest.mark.parametrize('change, error, message', [
    ({'t': None}, OptionError, 'times t in s, or the rate'),
    ({'rate': 5.0}, OptionError, 'not both'), ({'t': None, 'rate': -1.0}, OptionError, 'rate'),
    ({'tau': np.zeros((60, 3))}, DataError, r'\(60, 3\); expected'),
    ({'q': np.zeros(60)}, DataError, r'\(samples, joints\)'),
    ({'q': [np.zeros((60, 2))] * 2}, DataError, 'q has 2 runs'),
    ({'q': np.zeros((0, 2)), 'tau': np.zeros((0, 2)), 't': []}, DataError, 'shape'),
    ({'t': np.arange(59.0)}, DataError, r't has shape \(59,\)'),
    ({'names': ['a']}, DataError, '1 names for 2 joints'),
    ({'qd': np.full((60, 2), 5.0)}, DataError, 'contradicts q'),
    ({'tau': np.full((60, 2), np.nan)}, DataError, 'not finite'),
    ({'t': np.full(60, np.nan)}, DataError, 't or q .* not finite'),
    ({'q': np.where(np.arange(120).reshape(60, 2) == 7, np.nan, 1.0)}, DataError, 'not finite'),
    ({'effort_scale': 0.0}, OptionError, 'not 0'),
    ({'effort_scale': {'wrist': 1.0}}, ModelMismatchError, 'wrist')])
def test_invalid_arrays_are_refused(change, error, message):
    t, q, tau = arrays()
    with pytest.raises(error, match=message):
        gc.Recording.from_arrays(**{'q': q, 'tau': tau, 't': t, **change})


def test_split_parts_are_disjoint_and_record_the_holdout(data):
    train, test = data.split(0.4)
    assert not (train.usable & test.usable).any()
    assert set(train.used.runs) == {0, 1} and set(test.used.runs) == {2}
    assert test.holdout == train.holdout and len(train) == 2400
    one = gc.Recording(data.samples.run(0))
    train, test = one.split(0.3, guard=2.0)
    assert not (train.usable & test.usable).any() and len(train) + len(test) < len(one)
    gap = np.abs(train.used.t[:, None] - test.used.t[None, :]).min()
    assert gap > 2.0 and len(test.slow) == test.holdout.n_samples


def test_data_held_out_of_the_fit_are_not_diagnosed(data, loop):
    _, test, model, *_ = loop
    used = diagnose_recording(data, model.gravity).recording.usable
    assert used.any() and not (used & test.usable).any()


def test_an_error_names_the_remedy_in_python_and_in_a_terminal(bags, data, capsys):
    fast = gc.GateOptions(max_speed=1e-9)
    with pytest.raises(DataError) as error:
        gc.fit(gc.Recording(data.samples, fast))
    assert 'gate=None' in str(error.value)
    again = pickle.loads(pickle.dumps(error.value))  # as from a worker process
    assert str(again) == str(error.value)
    assert cli.main(['fit', bags[0], '--max-speed', '1e-9']) == 1
    assert '--all-samples' in capsys.readouterr().err
    with pytest.raises(OptionError, match='did you mean'):
        gc.fit(data, effects=['coulomb_frictoin'])
