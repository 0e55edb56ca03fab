"""Model files: a round trip is exact, and a damaged file is refused."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
import hashlib
import json
import os
from pathlib import Path
import sys

from bench.shared.serial_arms import planar_2r, poses, samples_of
from gravity_comp_ros.errors import DataError, ModelFileError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models import model_file
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel, Step
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from hypothesis import given, strategies as st
import numpy as np
import pytest


Q = poses(50, 2)
MODEL = fit(samples_of(Q, planar_2r(Q), 0.1), FitOptions('potential')).model


@pytest.fixture
def saved(tmp_path) -> Path:
    path = tmp_path / 'model.json'
    save_model(path, MODEL)
    return path


def check_same(a: GravityModel, b: GravityModel) -> None:
    assert (a.joints, a.formulation) == (b.joints, b.formulation)
    for one, other in zip((*a.torques, a.energy), (*b.torques, b.energy)):
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one.indices, other.indices)
            np.testing.assert_array_equal(one.weights, other.weights)
    np.testing.assert_array_equal(a.noise, b.noise)
    np.testing.assert_array_equal(a.coverage.q_min, b.coverage.q_min)
    np.testing.assert_array_equal(a.coverage.q_max, b.coverage.q_max)
    assert (a.coverage.n_samples, a.coverage.n_runs) == (b.coverage.n_samples,
                                                         b.coverage.n_runs)


def refused(path: Path, message: str) -> None:
    """Check that a file is refused with a message of one line that names it."""
    with pytest.raises(ModelFileError, match=message) as caught:
        load_model(path)
    assert str(path) in str(caught.value) and '\n' not in str(caught.value)


def signed(body: dict, **envelope) -> str:
    """Return the text of a file with this body and its checksum."""
    canonical = json.dumps(body, sort_keys=True, separators=(',', ':'))
    return json.dumps({'format': 'gravity_comp_ros model', 'version': model_file.VERSION,
                       'model': body,
                       'sha256': hashlib.sha256(canonical.encode()).hexdigest(), **envelope})


finite = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def models(draw):
    """Draw a model of 1 to 6 joints with any weights, names and provenance."""
    n = draw(st.integers(1, 6))
    names = tuple(draw(st.lists(st.text(min_size=1, max_size=8), min_size=n, max_size=n,
                                unique=True)))

    def expansion():
        features = sorted(draw(st.sets(st.integers(0, 3 ** n - 1), max_size=6)))
        weights = [draw(finite) for _ in features]
        return Expansion(np.array(features, dtype=np.int64), np.array(weights))

    vectors = [np.array([draw(finite) for _ in range(n)]) for _ in range(3)]
    coverage = Coverage(vectors[0], vectors[1], draw(st.integers(0, 10 ** 9)), 2)
    provenance = draw(st.dictionaries(st.text(max_size=5), finite | st.text(max_size=9)))
    if draw(st.booleans()):
        return GravityModel.from_energy(names, 'potential', expansion(), vectors[2], coverage,
                                        provenance)
    return GravityModel(names, 'per_joint', tuple(expansion() for _ in range(n)), None,
                        vectors[2], coverage, provenance)


@given(model=models())
def test_the_round_trip_of_any_model_is_exact(tmp_path_factory, model):
    path = tmp_path_factory.mktemp('model') / 'model.json'
    save_model(path, model)
    again = load_model(path)
    check_same(model, again)
    assert again.provenance == model.provenance


def test_truncated_files_are_refused(saved):
    data = saved.read_bytes()
    for length in [*range(0, len(data) - 1, 37), len(data) - 2, len(data) - 3]:
        saved.write_bytes(data[:length])
        refused(saved, 'truncated|not a model file')
    # The last line break is optional.
    saved.write_bytes(data[:-1])
    check_same(load_model(saved), MODEL)


def test_a_flipped_bit_does_not_change_the_model_silently(saved):
    data, rng = saved.read_bytes(), np.random.default_rng(0)
    outcomes = {'refused': 0, 'same': 0}
    for place, bit in zip(rng.integers(len(data), size=400), rng.integers(8, size=400)):
        damaged = bytearray(data)
        damaged[place] ^= 1 << bit
        saved.write_bytes(bytes(damaged))
        try:
            check_same(load_model(saved), MODEL)
            outcomes['same'] += 1
        except ModelFileError:
            outcomes['refused'] += 1
    assert outcomes['refused'] > 300


@pytest.mark.parametrize('version', [0, 5, None, '6'])
def test_another_version_is_refused(saved, version):
    saved.write_text(signed(json.loads(saved.read_text())['model'], version=version))
    refused(saved, 'this program reads version 6')


@pytest.mark.parametrize('data', [
    b'{}', b'[]', b'null', b'"text"', b'{"format": "other", "version": 1}',
    b'{"model": {}, "version": 1}', b'', b'not json', bytes(100),
    b'\x89PNG\r\n\x1a\n' + bytes(range(256)), b'\xff\xfe\x00'])
def test_other_files_are_refused(saved, data):
    saved.write_bytes(data)
    refused(saved, 'not a model file')


@pytest.mark.parametrize('depth', [100, 100000])
def test_deep_nesting_is_refused(saved, depth):
    nested = '[' * depth + ']' * depth
    saved.write_text(f'{{"format": "gravity_comp_ros model", "version": 6, "sha256": "0", '
                     f'"model": {{"joints": {nested}}}}}')
    refused(saved, 'damaged|not a model file')


@pytest.mark.parametrize('token', ['NaN', 'Infinity', '-Infinity', '1e999'])
def test_nan_and_infinity_are_refused(saved, token):
    text = saved.read_text()
    weight = repr(float(MODEL.energy.weights[0]))
    assert weight in text
    saved.write_text(text.replace(weight, token, 1))
    refused(saved, 'damaged|not a model file')


def replacing(**changes):
    """Return an edit that replaces parts of the body."""
    return lambda body: body.update(changes)


@pytest.mark.parametrize('edit', [
    replacing(joints=['axis0']), replacing(joints=['axis0', 'axis0']), replacing(joints='ab'),
    replacing(joints=[f'j{k}' for k in range(13)]), replacing(formulation='magic'),
    replacing(noise=[0.1]), replacing(noise=['0.1', '0.1']), replacing(coverage=None),
    replacing(coverage={'q_min': [0.0], 'q_max': [1.0], 'n_samples': 3, 'n_runs': 1}),
    replacing(energy={'indices': [1, 1], 'weights': [1.0, 1.0]}),
    replacing(energy={'indices': [9], 'weights': [1.0]}),
    replacing(energy={'indices': [10 ** 30], 'weights': [1.0]}),
    replacing(energy={'indices': [1], 'weights': [None]}),
    replacing(energy={'indices': [1.5], 'weights': [1.0]}),
    replacing(energy=None), replacing(surprise=1), lambda body: body.pop('noise')])
def test_an_invalid_file_with_a_valid_checksum_is_refused(saved, edit):
    body = json.loads(saved.read_text())['model']
    edit(body)
    saved.write_text(signed(body))
    refused(saved, 'not a valid model|formulation')


def test_a_missing_file_a_folder_and_large_files_are_refused(tmp_path, saved):
    refused(tmp_path / 'none.json', 'no such file')
    refused(tmp_path, 'is a directory')
    os.truncate(saved, 2 ** 40)
    for path in (saved, Path('/dev/zero')):
        refused(path, 'too large')


@pytest.mark.parametrize('noise, provenance', [
    ([0.1, np.nan], {}), ([0.1, np.inf], {}), ([0.1, 0.1], {'when': object()})])
def test_a_model_without_json_form_is_not_written(saved, noise, provenance):
    broken = GravityModel.from_energy(MODEL.joints, 'potential', MODEL.energy, np.array(noise),
                                      MODEL.coverage, provenance)
    with pytest.raises(ModelFileError, match='cannot write'):
        save_model(saved, broken)
    check_same(load_model(saved), MODEL)


def model_of(*torques: dict[int, float], q_min=None, q_max=None) -> GravityModel:
    """Return a model with these weights by feature, joint by joint."""
    n = len(torques)
    expansions = tuple(Expansion(np.array(sorted(t), dtype=np.int64),
                                 np.array([t[k] for k in sorted(t)])) for t in torques)
    return GravityModel(tuple(f'j{k}' for k in range(n)), 'per_joint', expansions, None,
                        np.zeros(n), Coverage(-np.ones(n) if q_min is None else q_min,
                                              np.ones(n) if q_max is None else q_max, 10))


def test_equations_in_the_notation_of_the_paper():
    model = model_of({5: -20.81, 1: 3.1, 0: -0.5}, {})
    assert model.equation('j0') == '-20.81 s1 c2 + 3.10 s2 - 0.50 1'
    assert model.equation('j0', digits=0) == '-21 s1 c2 + 3 s2 - 0 1'
    assert model.equation('j1') == '0'
    first, *others = model.torques
    weak = replace(model, torques=(replace(first, weights=1e-3 * first.weights), *others))
    assert weak.equation('j0') == '-0.021 s1 c2 + 0.003 s2 - 0.001 1'
    np.testing.assert_array_equal(model.n_features(), [3, 0])
    with pytest.raises(DataError, match='no joint j9 in the model; it has j0, j1'):
        model.equation('j9')


@given(n_joints=st.integers(1, 7), seed=st.integers(0, 10 ** 6))
def test_predict_one_agrees_with_predict(n_joints, seed):
    rng = np.random.default_rng(seed)
    model = model_of(*({int(k): float(rng.normal()) for k in rng.choice(3 ** n_joints, 3)}
                       for _ in range(n_joints)))
    q = rng.uniform(-7, 7, (4, n_joints))
    np.testing.assert_allclose([model.predict_one(pose) for pose in q], model.predict(q),
                               atol=1e-12)


def test_threads_share_a_model():
    model = model_of({5: -20.0, 1: 3.0}, {7: 2.0, 0: 1.0})
    poses = np.random.default_rng(0).uniform(-3.0, 3.0, (2, 2))
    expected = model.predict(poses)

    def worst(k):
        return max(np.abs(model.predict_one(poses[k]) - expected[k]).max() for _ in range(5000))

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            assert max(pool.map(worst, range(2))) < 1e-12
    finally:
        sys.setswitchinterval(interval)


def test_distance_from_the_trained_range():
    model = model_of({}, {}, q_min=[-1.0, 0.0], q_max=[1.0, 0.5])
    assert model.extrapolation(np.array([0.0, 0.2])) == 0.0
    assert model.extrapolation(np.array([1.0, 0.5])) == 0.0
    assert model.extrapolation(np.array([1.2, 0.2])) == pytest.approx(0.2)
    assert model.extrapolation(np.array([1.2, -0.7])) == pytest.approx(0.7)
    np.testing.assert_allclose(
        model.coverage.distance(np.array([[1.2, -0.7], [-3.0, 0.1]])), [[0.2, 0.7], [2.0, 0.0]])


@pytest.mark.parametrize('indices, weights, message', [
    ([1, 1], [1.0, 1.0], 'ascending and unique'), ([2, 1], [1.0, 1.0], 'ascending'),
    ([-1], [1.0], 'ascending'), ([1], [], 'weights'), ([[1]], [[1.0]], 'weights'),
    ([1], [np.nan], 'not finite'), ([1], [np.inf], 'not finite')])
def test_invalid_expansions_are_refused(indices, weights, message):
    with pytest.raises(DataError, match=message):
        Expansion(np.array(indices), np.array(weights))


def test_models_with_inconsistent_parts_are_refused():
    good, one = model_of({1: 1.0}, {}), Expansion(np.array([9]), np.array([1.0]))
    with pytest.raises(DataError, match='outside the dictionary of 2 joints'):
        GravityModel(good.joints, 'per_joint', (one, one), None, good.noise, good.coverage)
    with pytest.raises(DataError, match='2 joint names'):
        GravityModel(good.joints, 'per_joint', good.torques[:1], None, good.noise,
                     good.coverage)
    with pytest.raises(DataError, match='model of 2 joints was given poses of 3'):
        good.predict(np.zeros((5, 3)))
    with pytest.raises(DataError, match='joint names'):
        GravityModel(('a', 'a'), 'per_joint', good.torques, None, good.noise, good.coverage)


EFFECT = AppliedEffect('x', 'elsewhere', {}, {'b': Value(1.0, 'N·m', (0.9, 1.1))})


@pytest.mark.parametrize('make', [
    lambda: Value(float('nan'), 'N·m', (0.0, 1.0)), lambda: AppliedEffect('x', None, {}, {}),
    lambda: AppliedEffect('x', None, {'speed': float('inf')}, EFFECT.coefficients),
    lambda: Applied((EFFECT, EFFECT)), lambda: Step('forgotten', (), 'today'),
    lambda: replace(MODEL, applied=Applied((EFFECT,))),
    lambda: replace(MODEL, fitted=Applied((EFFECT,)))])
def test_invalid_effects_are_refused(make):
    with pytest.raises(DataError):
        make()
