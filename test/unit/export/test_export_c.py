"""The exported C source: compiled without a warning, and equal to the model in Python."""

from dataclasses import replace
import subprocess

from bench.shared.compiled_model import compiled
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.motion_direction import COMPENSATION_SPEED
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.export.c_source import c_source, parameters_of
from gravity_comp_ros.export.effect_code import FRICTION, STATIC
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, expand, tilt
from gravity_comp_ros.models.model_file import checksum, load_model, save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np
import pytest

N = 7
JOINTS = tuple(f'joint {n} "\\?*/' for n in range(N))
KINDS = ('chain', 'potential', 'per_joint')


def model_of(kind: str, seed: int = 0, right_angles: bool = False) -> GravityModel:
    """Return a random model of a formulation; with right angles its energy has few terms."""
    rng = np.random.default_rng(seed)
    coverage = Coverage(-1 - rng.random(N), 1 + rng.random(N), 100)
    if kind == 'chain':
        tilts = np.pi / 2 * np.eye(2)[rng.integers(0, 2, N)] if right_angles \
            else rng.normal(0, 1.2, (N, 2))
        axes = tilt(tilts)
        chain = Chain(axes, rng.normal(0, 20, (N, 2)))
        return GravityModel.from_energy(JOINTS, kind, expand(chain), np.ones(N), coverage, {},
                                        chain)
    if kind == 'potential':
        indices = np.sort(rng.choice(3 ** N, 60, replace=False))
        return GravityModel.from_energy(JOINTS, kind, Expansion(indices, rng.normal(0, 9, 60)),
                                        np.ones(N), coverage, {})
    # The constant is a feature of a torque too; the last joint has no feature.
    torques = [Expansion(np.r_[0, np.sort(rng.choice(3 ** N - 1, 20, replace=False)) + 1],
                         rng.normal(0, 9, 21)) for _ in range(N - 1)]
    none = Expansion(np.zeros(0, dtype=int), np.zeros(0))
    return GravityModel(JOINTS, kind, (*torques, none), None, np.ones(N), coverage)


EFFECTS = (
    ('torque_offset', 0, {}, {'b': 0.7}), ('torque_gain', 1, {}, {'k': -0.08}),
    ('torque_offset', 2, {'start_1': 1e9, 'start_2': 2e9}, {'b': 0.4, 'd_1': 0.3}),
    ('torque_gain', 4, {'recording_1': 7.0, 'recording_2': 8.0}, {'k': 0.06, 'd_1': 0.02}),
    ('joint_spring', 1, {'centre': 0.3, 'overtones': 0.0}, {'k': 4.0, 'm': 0.5}),
    ('joint_spring', 2, {'centre': 0.3, 'overtones': 2.0},
     {'a_2': 1.0, 'a_3': -0.4, 'b_2': 0.6, 'b_3': 0.2}),
    ('cable_stiffness', 3,
     {'start': 0.2, 'side': 1.0, 'half': 1.4, 'order': 1.5, 'hardening': 0.1}, {'k': 3.0}),
    ('cable_stiffness', 4,
     {'start': -0.2, 'side': 0.0, 'half': 1.4, 'order': 3.0, 'hardening': 1.0}, {'k': 2.0}),
    ('cable_stiffness', 6,
     {'start': 0.1, 'side': -1.0, 'half': 1.4, 'order': 2.0, 'hardening': 0.3}, {'k': 2.5}),
    ('end_stop', 4, {'start': -0.9, 'side': -1.0}, {'k': 30.0}),
    ('torque_ripple', 5, {'k': 40.5, 'harmonics': 1.0}, {'a': 0.3, 'b': -0.2}),
    ('torque_ripple', 2, {'k': 12.0, 'harmonics': 3.0},
     {'a_1': 0.3, 'a_2': -0.5, 'a_3': 0.2, 'b_1': -0.4, 'b_2': 0.1, 'b_3': 0.6}),
    ('coulomb_friction', 0, {'width': 0.004}, {'F_c': 1.5}),
    ('coulomb_friction', 1, {'ramp': 0.02}, {'F_c': 2.5}),
    ('viscous_friction', 2, {}, {'F_v': 3.0}),
    ('asymmetric_friction', 3, {'ramp': 0.03}, {'F_a': 0.4}),
    ('load_dependent_friction', 4, {'width': 0.01}, {'mu': 0.06}),
    ('load_dependent_friction', 3, {'width': 0.01, 'friction': 0.7}, {'mu': 0.05}),
    ('stribeck_friction', 5, {'speed': 0.05, 'width': 0.003}, {'F_s': 0.8}),
    ('degressive_friction', 6, {'power': 2.0 / 3.0, 'width': 0.002}, {'F_d': 1.1}),
    ('coupled_friction', 5, {'partner': 7.0, 'sign': -1.0, 'ramp': 0.02}, {'F_k': 0.9}))


def with_effects(model: GravityModel, effects=EFFECTS) -> GravityModel:
    """Return a model with effects."""
    applied = tuple(AppliedEffect(name, JOINTS[joint], setting,
                                  {symbol: Value(x, '', (x, x)) for symbol, x in values.items()})
                    for name, joint, setting, values in effects)
    return replace(model, applied=Applied(applied))


def poses(count: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (count, N)), rng.normal(0, 0.05, (count, N))


def effects_at(model, q, qd):
    """Return the torque of the effects in Python."""
    samples = JointSamples.single_run(model.joints, np.arange(len(q)), q, qd, np.zeros_like(q))
    return effect_torque(model, samples)


@pytest.mark.parametrize('kind, compiler', [
    *((kind, 'c99') for kind in KINDS), ('chain', 'c++17')])
def test_ten_thousand_poses_agree_with_python(kind, compiler, tmp_path):
    model = with_effects(model_of(kind))
    library, (q, qd) = compiled(model, tmp_path, compiler), poses(10 ** 4)
    expected = model.predict(q)
    assert np.abs(expected).max() > 30.0
    np.testing.assert_allclose(library.gravity(q), expected, rtol=0, atol=1e-9)
    static = replace(model, applied=replace(model.applied, effects=tuple(
        effect for effect in model.applied.effects if effect.name in STATIC)))
    np.testing.assert_allclose(library.static(q), expected + effects_at(static, q, qd),
                               rtol=0, atol=1e-9)
    np.testing.assert_allclose(library.static(q) + library.friction(q, qd),
                               expected + effects_at(model, q, qd), rtol=0, atol=1e-9)
    np.testing.assert_allclose(library.distance(q), model.coverage.distance(q).max(axis=1),
                               rtol=0, atol=1e-15)


def test_single_precision(tmp_path):
    model = with_effects(model_of('chain'))
    library, (q, qd) = compiled(model, tmp_path, 'float'), poses(2000)
    # A speed of a few millirad/s over a width of the same size: rounding of q alone is 1e-7 rad.
    assert np.abs(library.gravity(q) - model.predict(q)).max() < 1e-3
    assert np.abs(library.static(q) + library.friction(q, qd) - model.predict(q)
                  - effects_at(model, q, qd)).max() < 3e-3


def test_every_law_is_of_an_effect_in_the_library_and_tested():
    assert set(STATIC) | set(FRICTION) == {effect[0] for effect in EFFECTS}
    assert set(STATIC) | set(FRICTION) <= set(library_effects())


def test_effects_without_a_law_are_left_out_by_name(tmp_path):
    model = with_effects(model_of('chain'), [
        ('torque_drift', 0, {'origin': 0.0, 'time': 100.0},
         {'r': 0.1, 'b': 2.0}),
        ('presliding_hysteresis', 0, {'distance': 0.001}, {'F_p': 2.0, 'sigma': 0.1}),
        ('encoder_offset', 2, {'run': 2.0, 'time': 0.0, 'clock': 0.0}, {'delta': 0.04}),
        ('coulomb_friction', 1, {'width': 0.004}, {'F_new': 2.0}),
        ('joint_spring', 1, {}, {'k': 4.0}),
        ('torque_ripple', 2, {'k': 12.0, 'harmonics': 2.0}, {'a': 0.1, 'b': 0.2})])
    code = c_source(model)
    assert not code.effects and len(code.left_out) == len(model.applied.effects)
    # The first three depend on time or on the path, the others are not those of the library.
    assert [why.startswith('it has no law') for why in code.left_out.values()] == [
        *3 * [True], *3 * [False]]
    library, (q, qd) = compiled(model, tmp_path), poses(5)
    np.testing.assert_array_equal(library.static(q), library.gravity(q))
    np.testing.assert_array_equal(library.friction(q, qd), 0.0)
    assert parameters_of(model).layout == parameters_of(model_of('chain')).layout
    assert 'torque_drift:joint 0' in code.header


def test_friction_that_persists_at_rest_acts_in_motion_only(tmp_path):
    def friction(law):
        skew = {'skew': 0.4} if 'distance' in law else {}
        return with_effects(model_of('potential', 4), [
            ('coulomb_friction', 0, law, {'F_c': 2.0}),
            ('asymmetric_friction', 3, {**law, **skew}, {'F_a': 0.5}),
            ('load_dependent_friction', 4, {**law, 'friction': 0.7}, {'mu': 0.05}),
            ('stribeck_friction', 5, {**law, 'speed': 0.05}, {'F_s': 0.8})])

    model = friction({'distance': 0.001})
    code, (q, qd) = c_source(model), poses(300)
    targets = tuple(effect.target for effect in model.applied.effects)
    assert code.effects == code.in_motion == targets and not code.left_out
    assert code.header.count('in motion only') == 4
    in_motion = friction({'width': COMPENSATION_SPEED})
    assert parameters_of(model).layout == parameters_of(in_motion).layout
    assert not c_source(in_motion).in_motion
    library = compiled(model, tmp_path)
    np.testing.assert_allclose(library.friction(q, qd), effects_at(in_motion, q, qd), rtol=0,
                               atol=1e-9)
    np.testing.assert_array_equal(library.friction(q, 0 * qd), 0.0)


@pytest.mark.parametrize('kind', KINDS)
def test_parameters_of_another_model_give_its_torque(kind, tmp_path):
    old = with_effects(model_of(kind))
    library, (q, qd) = compiled(old, tmp_path), poses(300)
    new = replace(old, applied=with_effects(old, [
        (name, joint, setting, {symbol: 1.3 * x for symbol, x in values.items()})
        for name, joint, setting, values in EFFECTS]).applied,
        coverage=Coverage(old.coverage.q_min - 0.5, old.coverage.q_max, 1))
    if kind == 'chain':
        chain = Chain(old.chain.axes @ tilt(np.full((N, 2), 0.02)), 1.1 * old.chain.moments)
        new = replace(new, chain=chain, energy=expand(chain), torques=tuple(
            expand(chain).gradient(N, joint) for joint in range(N)))
    elif kind == 'potential':
        energy = Expansion(old.energy.indices, 1.1 * old.energy.weights)
        new = replace(new, energy=energy, torques=tuple(
            energy.gradient(N, joint) for joint in range(N)))
    else:
        new = replace(new, torques=tuple(Expansion(torque.indices, 1.1 * torque.weights)
                                         for torque in old.torques))
    parameters = parameters_of(new)
    before = library.gravity(q)
    assert library.set_parameters(parameters.values, parameters.layout) == 0
    assert np.abs(library.gravity(q) - before).max() > 1.0
    np.testing.assert_allclose(library.gravity(q), new.predict(q), rtol=0, atol=1e-9)
    np.testing.assert_allclose(library.static(q) + library.friction(q, qd),
                               new.predict(q) + effects_at(new, q, qd), rtol=0, atol=1e-9)
    np.testing.assert_allclose(library.distance(q), new.coverage.distance(q).max(axis=1))


def test_refused_parameters_change_nothing(tmp_path):
    model = with_effects(model_of('chain'))
    library, (q, _) = compiled(model, tmp_path), poses(10)
    good, before = parameters_of(model), library.static(q)

    def result(index=None, value=0.0, layout=good.layout, values=good.values):
        values = values.copy()
        if index is not None:
            values[index] = value
        return library.set_parameters(values, layout)

    labels = list(good.labels)
    width = labels.index(f'coulomb_friction:{JOINTS[0]} width rad/s')
    assert result(values=good.values[:-1]) == 1
    assert result(layout=good.layout ^ 1) == 2
    assert {result(20, bad) for bad in (np.nan, np.inf, -np.inf)} == {3}
    assert result(0, 3.0) == 4
    assert result(width, 0.0) == 5
    rotation = labels.index(f'{JOINTS[3]} A_11')
    assert result(rotation, good.values[rotation] + 1e-4) == 6
    mirrored = good.values.copy()
    mirrored[rotation:rotation + 9] *= -1.0
    assert result(values=mirrored) == 6
    np.testing.assert_array_equal(library.static(q), before)
    assert result() == 0


def test_a_pose_that_is_not_finite_gives_no_finite_torque(tmp_path):
    for kind in KINDS:
        (tmp_path / kind).mkdir()
        library, q = compiled(model_of(kind), tmp_path / kind), np.zeros((1, N))
        q[0, 2] = np.nan
        assert np.isnan(library.gravity(q)).any() and np.isnan(library.distance(q)).all(), kind


def test_labels_are_unique_and_the_layout_depends_on_them():
    layouts = set()
    for model in [model_of(kind, seed) for kind in KINDS for seed in (0, 1)]:
        parameters = parameters_of(model)
        assert len(set(parameters.labels)) == len(parameters.labels) == len(parameters.values)
        layouts.add(parameters.layout)
    # Chains of one arm have the same layout, sparse models of other features another one.
    assert len(layouts) == 5


def test_the_header_names_model_and_joints(tmp_path):
    path = tmp_path / 'arm.json'
    save_model(path, model_of('chain'))
    model = load_model(path)
    code = c_source(model)
    assert f'"{checksum(model)}"' in code.header and checksum(model) in path.read_text()
    assert c_source(model).source == code.source


def test_two_arms_in_one_program(tmp_path):
    for prefix, seed in (('left', 1), ('gc_right', 2)):
        code = c_source(with_effects(model_of('chain', seed)), prefix)
        (tmp_path / code.header_name).write_text(code.header)
        (tmp_path / code.source_name).write_text(code.source)
    (tmp_path / 'main.c').write_text(
        '#include "left_gravity.h"\n#include "gc_right_gravity.h"\n#include <stdio.h>\n'
        'int main(void) { double q[LEFT_N] = {0.1}, a[LEFT_N], b[GC_RIGHT_N];\n'
        'left_static(q, a); gc_right_static(q, b); printf("%.12f %.12f", a[1], b[1]);'
        'return 0; }\n')
    done = subprocess.run(['gcc', '-std=c99', '-Wall', '-Werror', 'main.c', 'left_gravity.c',
                           'gc_right_gravity.c', '-lm', '-o', 'main'], cwd=tmp_path,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    printed = subprocess.run([tmp_path / 'main'], capture_output=True, text=True).stdout.split()
    q = np.eye(1, N) * 0.1
    for value, seed in zip(printed, (1, 2)):
        model = with_effects(model_of('chain', seed))
        expected = model.predict(q) + effects_at(model, q, 0 * q)
        assert float(value) == pytest.approx(expected[0, 1], abs=1e-9)


@pytest.mark.parametrize('prefix', ['', '1a', 'Left', 'a-b', 'a b', 'x' * 40])
def test_a_prefix_that_is_no_name_is_refused(prefix):
    with pytest.raises(OptionError, match='prefix'):
        c_source(model_of('chain'), prefix)
