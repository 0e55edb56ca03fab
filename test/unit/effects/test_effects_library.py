"""Every effect of the library: documentation, columns, and identifiability."""

from dataclasses import replace
import re

from bench.shared.effect_motions import (
    ARMS, base_columns, clean_motion, least_squares, NOISE, session_motion)
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.effects.effect import Coefficient, Effect
from gravity_comp_ros.effects.offset import TorqueOffset
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.errors import OptionError
import numpy as np
import pytest

EFFECTS = library_effects()
NAMES = (
    'coulomb_friction', 'viscous_friction', 'stribeck_friction', 'degressive_friction',
    'asymmetric_friction', 'load_dependent_friction', 'friction_drift', 'presliding_hysteresis',
    'coupled_friction', 'torque_offset', 'torque_gain', 'torque_drift', 'joint_spring',
    'cable_stiffness', 'torque_ripple', 'encoder_offset', 'base_tilt', 'payload_change',
    'rigid_body_dynamics', 'joint_flexibility', 'time_delay', 'end_stop',
    'tool_force')
# Gravity absorbs a constant factor of a torque.
IN_THE_BASE = {'torque_gain'}
# Effects whose torque on a joint does not depend on the order of the joints in the chain.
ORDERLESS = [name for name in NAMES if name not in {
    'coupled_friction', 'rigid_body_dynamics', 'base_tilt', 'payload_change', 'tool_force'}]
each_effect = pytest.mark.parametrize('effect', EFFECTS.values(), ids=list(EFFECTS))
each_arm = pytest.mark.parametrize('arm', ARMS)


def cases(effect, motion):
    """Yield (joint, settings) on which an effect can be tested."""
    every = range(motion.samples.n_joints) if effect.per_joint else [0]
    for joint in every:
        if effect.untestable(motion, joint) is None:
            yield joint, effect.settings(motion, joint)


def some(settings):
    """Return the first, the middle and the last."""
    return [settings[k] for k in sorted({0, len(settings) // 2, len(settings) - 1})]


def whole(columns, joint, n_joints):
    """Return columns (M, N, K), zero on other joints for an effect of one joint."""
    if columns.ndim == 3:
        return columns
    out = np.zeros((len(columns), n_joints, columns.shape[1]))
    out[:, joint] = columns
    return out


def test_names_are_stable_and_all_effects_testable_on_an_exciting_motion():
    assert sorted(EFFECTS) == sorted(NAMES)
    motion = session_motion('iiwa7')
    blind = {name for name, effect in EFFECTS.items() if not list(cases(effect, motion))}
    assert blind == set()


@each_effect
def test_documentation_of_an_effect_is_complete(effect):
    for text in (effect.title, effect.description, effect.equation, effect.source,
                 effect.signature):
        assert text.strip() and '\n' not in text
    assert '{joint}' in effect.experiment or not effect.per_joint
    assert bool(effect.confounders) != effect.is_shared
    assert {*effect.confounders, *effect.corrects} <= set(NAMES) - {effect.name}
    assert all(effect.name in EFFECTS[other].confounders for other in effect.confounders)
    # Only ratios have no unit: a friction coefficient and a gain.
    ratios = {'load_dependent_friction', 'torque_gain'}
    for coefficient in effect.coefficients:
        assert coefficient.symbol and coefficient.meaning
        assert bool(coefficient.unit) != (effect.name in ratios)


def kinds(setting):
    """Return the names of nonlinear parameters, `k` for a recording's number."""
    return {re.sub(r'\d+$', 'k', name) for name in setting}


@each_arm
@each_effect
def test_columns_are_finite_shaped_and_named(effect, arm):
    motion = clean_motion(arm)
    m, n = motion.samples.q.shape
    for joint in range(n):
        settings = effect.settings(motion, joint)
        if effect.untestable(motion, joint) is None:
            assert settings, 'testable, but without settings'
            assert all(kinds(setting) <= set(effect.setting_units) for setting in settings)
        for setting in some(settings) if settings else []:
            columns = effect.columns(motion, joint, setting)
            k = len(effect.coefficients_of(motion, joint, setting))
            assert columns.shape == ((m, k) if effect.scope == 'joint' else (m, n, k))
            assert columns.dtype == np.float64 and np.isfinite(columns).all()
            assert kinds(setting) <= set(effect.setting_units)
            assert all(np.isfinite(value) for value in setting.values())
            std = effect.prior_std(10.0, np.sqrt((columns ** 2).mean(
                axis=tuple(range(columns.ndim - 1)))))
            assert std.shape == (k,) and (std > 0).all() and np.isfinite(std).all()
            again = effect.columns(motion, joint, setting)
            np.testing.assert_array_equal(columns, again)
            for finer in effect.refine(motion, joint, setting, 1.0):
                assert np.isfinite(effect.columns(motion, joint, finer)).all()


@each_arm
@each_effect
def test_coefficients_are_recovered(effect, arm):
    motion = clean_motion(arm)
    n, rng, tested = motion.samples.n_joints, np.random.default_rng(3), 0
    for joint, settings in list(cases(effect, motion))[:3]:
        setting = settings[len(settings) // 2]
        columns = whole(effect.columns(motion, joint, setting), joint, n)
        size = np.sqrt((columns ** 2).mean(axis=(0, 1)))
        truth = rng.uniform(0.5, 2.0, columns.shape[2]) / np.where(size > 0, size, 1.0)
        for place in range(n):
            here = np.abs(columns[:, place]).max(axis=0) > 1e-9 * np.abs(columns).max()
            if not here.any():
                continue
            base = base_columns(motion, place)
            known = np.column_stack([columns[:, place, here], base])
            y = (base @ rng.normal(size=base.shape[1]) + columns[:, place, here] @ truth[here]
                 + NOISE * rng.standard_normal(len(base)))
            solution, spread = least_squares(known, y, NOISE)
            count = int(here.sum())
            if np.linalg.matrix_rank(known) < known.shape[1]:
                # Only their sum is identifiable; the prediction must still be right.
                np.testing.assert_allclose(known @ solution, y, atol=6 * NOISE)
                continue
            assert (np.abs(solution[:count] - truth[here]) < 5 * spread[:count]).all()
            tested += bool((spread[:count] < 0.2 * np.abs(truth[here])).all())
    if list(cases(effect, motion)) and effect.name not in IN_THE_BASE:
        assert tested, 'collinear with gravity on every joint'


@pytest.mark.parametrize('name', ORDERLESS)
def test_the_order_of_the_joints_does_not_matter(name):
    effect, motion = EFFECTS[name], clean_motion('six_axis')
    order = [3, 0, 5, 1, 4, 2]
    moved = reordered(motion, order)
    for joint, settings in list(cases(effect, motion))[:2]:
        setting, place = some(settings)[-1], order.index(joint)
        assert effect.untestable(moved, place) is None
        columns = effect.columns(motion, joint, setting)
        if effect.scope == 'arm':
            columns = columns[:, order]
        np.testing.assert_allclose(effect.columns(moved, place, setting), columns, rtol=1e-9,
                                   atol=1e-9)


def reordered(motion, order):
    """Return the same motion with its joints in another order."""
    names, back = [motion.samples.names[n] for n in order], np.argsort(order)
    return replace(
        motion, samples=motion.samples.joints(names), qdd=motion.qdd[:, order],
        gravity=motion.gravity[:, order], chain=None, geometry=None, memo={},
        gravity_gradient=lambda q: motion.gravity_gradient(q[:, back])[:, order][:, :, order])


@each_effect
def test_columns_of_a_part_of_a_motion_are_those_of_the_whole(effect):
    # Coefficients of one recording must have the same meaning on another.
    motion = session_motion('six_axis')
    joint, settings = list(cases(effect, motion))[-1]
    last = motion.samples.runs == 2
    part = part_of(motion, last, motion.samples.run(2))
    for setting in some(settings):
        columns = effect.columns(part, joint, setting)
        if 'run' in setting:
            setting = {**setting, 'run': setting['run'] + 2}
        np.testing.assert_allclose(
            columns, effect.columns(motion, joint, setting)[last], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('name', ['friction_drift', 'presliding_hysteresis', 'torque_drift'])
def test_states_start_again_where_a_run_is_cut(name):
    effect, motion = EFFECTS[name], clean_motion('six_axis')
    setting = effect.settings(motion, 0)[-1]
    one = motion.samples.run(0)
    half = np.arange(len(one)) < 900
    cut = concatenate([one.select(half), one.select(~half)])
    here = motion.samples.runs == 0
    whole_run = effect.columns(part_of(motion, here, one), 0, setting)
    in_two = effect.columns(part_of(motion, here, cut), 0, setting)
    # Of presliding, the state; its rate differs at the cut alone.
    change = np.abs(np.diff((whole_run - in_two)[:, 0]))
    assert change.argmax() in (899, 900) and change.max() > 0.05


def part_of(motion, here, samples):
    """Return the part of a motion that `samples` are."""
    return replace(motion, samples=samples, qdd=motion.qdd[here], gravity=motion.gravity[here],
                   memo={})


LIMITED = ('load_dependent_friction', 'torque_gain', 'encoder_offset', 'base_tilt',
           'joint_flexibility', 'time_delay')


@pytest.mark.parametrize('name', LIMITED)
def test_a_coefficient_above_its_limit_is_implausible(name):
    effect = EFFECTS[name]
    values = np.zeros(len(effect.coefficients))
    assert effect.implausible(values + 0.99 * effect.largest, {}) is None
    reason = effect.implausible(values + 1.01 * effect.largest, {})
    assert 'is too large' in reason and effect.why_not_larger in reason


POSITIVE = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'degressive_friction',
            'load_dependent_friction', 'coupled_friction', 'cable_stiffness', 'end_stop',
            'joint_flexibility', 'joint_spring')


@pytest.mark.parametrize('name', NAMES)
def test_a_negative_coefficient_is_implausible_where_physics_excludes_it(name):
    one = np.full(len(EFFECTS[name].coefficients), 1e-6)
    reason = EFFECTS[name].implausible(-one, {})
    assert (reason is not None and 'negative' in reason) == (name in POSITIVE)
    assert EFFECTS[name].implausible(one, {}) is None


def test_inconsistent_attributes_are_refused():
    def changed(**attributes):
        return type('Changed', (TorqueOffset,), attributes)()

    with pytest.raises(OptionError, match="torque_offset: scope is 'leg'"):
        changed(scope='leg')
    with pytest.raises(OptionError, match='no coefficient'):
        changed(coefficients=())
    with pytest.raises(OptionError, match='per_joint'):
        changed(per_joint=False)
    assert isinstance(changed(coefficients=(Coefficient('b', 'N·m', 'x'),)), Effect)


def test_missing_attributes_are_named():
    class Silent(Effect):
        name = 'silent'
        title = 'T'

        def columns(self, motion, joint, setting):
            return motion.qdd[:, [joint]]

    with pytest.raises(OptionError, match='effect silent has no family, equation, description'):
        Silent()
    with pytest.raises(TypeError, match='columns'):
        Effect()
