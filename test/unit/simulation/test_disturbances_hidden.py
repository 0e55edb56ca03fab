"""Hidden effects by name, and `synth --hidden`."""

import json

from gravity_comp_ros.cli import main
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.disturbances.friction import Friction, LuGre
from gravity_comp_ros.simulation.hidden import hidden, KINDS, size_table
from gravity_comp_ros.simulation.motions import sample
from gravity_comp_ros.simulation.synthesise import Signals
from mcap.reader import make_reader
import numpy as np
import pytest

ARM = iiwa7()


def test_joint_by_name_or_number_and_sizes():
    expected = Friction(3, LuGre(0.8))
    assert hidden('coulomb_friction:4=0.8', ARM).disturbance == expected
    assert hidden('coulomb_friction:iiwa_joint_4=0.8', ARM).disturbance == expected
    assert hidden('coulomb_friction:2', ARM).disturbance == Friction(1, LuGre(1.0))
    assert hidden('coulomb_friction:6', ARM).size == pytest.approx(0.3)


@pytest.mark.parametrize('name', sorted(KINDS))
def test_every_hidden_effect_changes_the_signals(name):
    def path(t):
        angle = np.outer(t, 0.1 * np.arange(2, 9))
        return 1.9 * np.sin(angle), np.cos(angle) * 0.19 * np.arange(2, 9), -np.sin(angle)

    motion = sample('sweep', path, 60.0, 20.0)
    still = Signals(motion.q, motion.qd, gravity_torque(ARM, motion.q))
    text = name if KINDS[name].whole_arm else f'{name}:2'
    added = hidden(text, ARM)
    out = added.disturbance.apply(still, motion, ARM)
    again = hidden(f'{text}={added.size}', ARM).disturbance.apply(still, motion, ARM)
    assert np.array_equal(again.tau, out.tau) and np.array_equal(again.q, out.q)
    change = np.abs(out.tau - still.tau).max() + np.abs(out.q - still.q).max()
    assert 0.005 < change < 100.0
    assert np.isfinite(out.tau).all() and np.isfinite(out.q).all()


@pytest.mark.parametrize('text, word', [
    ('gremlins', 'coulomb_friction'), ('coulomb_friction:9', 'no joint 9'),
    ('coulomb_friction:4=nan', 'not a number'), ('base_tilt:1', 'whole arm'),
    ('coulomb_friction:2=-1', 'above 0 N·m'), ('torque_offset:2=0', 'other than 0'),
    ('coulomb_friction=0.8', 'on which joint')])
def test_invalid_hidden_effects_are_refused(text, word):
    with pytest.raises(OptionError, match=word):
        hidden(text, ARM)


def test_synth_writes_the_hidden_effect(tmp_path):
    def record(name, *more):
        assert main(['synth', '--motion', 'multisine', '--duration', '30', '--seed', '2', *more,
                     '-o', str(tmp_path / name)]) == 0
        return read_bag(tmp_path / name).samples

    undisturbed = record('undisturbed.mcap')
    disturbed = record('disturbed.mcap', '--hidden', 'coulomb_friction:4=0.8', '--hidden',
                       'torque_offset:1=-0.5')
    change = disturbed.tau - undisturbed.tau
    moving = np.abs(undisturbed.qd[:, 3]) > 0.02
    assert change[moving, 3] == pytest.approx(0.8 * np.sign(undisturbed.qd[moving, 3]), abs=0.02)
    assert change[:, 0] == pytest.approx(-0.5)
    assert not change[:, [1, 2, 4, 5, 6]].any()


def test_sizes_have_the_units_of_diagnose():
    for name, effect in all_effects().items():
        if name in KINDS and name != 'tool_force':   # reported by joint, hidden as one force
            assert KINDS[name].unit == effect.coefficients[0].unit, name
    assert max(map(len, size_table().splitlines())) < 80


def test_sizes_are_those_of_the_disturbance():
    t = np.linspace(0, 10, 2001)
    still = Signals(np.zeros((2001, 7)), np.zeros((2001, 7)), np.zeros((2001, 7)))
    motion = sample('still', lambda t: (np.zeros((len(t), 7)),) * 3, 10.005, 200.0)
    drift = hidden('torque_drift:2=2', ARM).disturbance
    rise = drift.apply(still, motion, ARM).tau[:, 1]
    assert np.polyfit(t[:200], rise[:200], 1)[0] == pytest.approx(0.01, rel=0.02)
    friction = hidden('asymmetric_friction:2=0.5', ARM).disturbance
    up, down = friction.surfaces.coulomb, friction.backward.coulomb
    assert 0.5 * (up - down) == pytest.approx(0.5)


def test_hidden_effects_are_printed_and_stored_in_the_bag(tmp_path, capsys):
    path = tmp_path / 'x.mcap'
    call = ['synth', '--motion', 'multisine', '--duration', '5', '--hidden', 'coulomb_friction:4',
            '--hidden', 'base_tilt=0.05', '-o', str(path)]
    assert main(call) == 0
    printed = capsys.readouterr().out
    assert 'hidden: coulomb_friction on iiwa_joint_4: 1 N·m' in printed
    assert 'hidden: base_tilt: 0.05 rad' in printed
    with path.open('rb') as stream:
        (record,) = make_reader(stream).iter_metadata()
    stored = json.loads(record.metadata['hidden'])
    assert record.name == 'gravity_comp_synth' and 'base_tilt=0.05' in record.metadata['command']
    assert stored[0] == {'effect': 'coulomb_friction', 'joint': 'iiwa_joint_4', 'size': 1.0,
                         'unit': 'N·m'}
    assert main([*call, '--json']) == 0
    assert json.loads(capsys.readouterr().out)['hidden_sizes'] == stored
