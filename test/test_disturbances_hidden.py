"""Hidden effects by name, and `synth --hidden`."""

from gravity_comp_ros.cli import main
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.disturbances.friction import Friction
from gravity_comp_ros.simulation.disturbances.lugre import LuGre
from gravity_comp_ros.simulation.hidden import hidden, KINDS
from gravity_comp_ros.simulation.motions import sample
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pytest

ARM = iiwa7()


def test_a_joint_goes_by_name_or_number_and_a_size_is_taken_as_it_is():
    expected = Friction(3, LuGre(0.8))
    assert hidden('coulomb_friction:4=0.8', ARM) == expected
    assert hidden('coulomb_friction:iiwa_joint_4=0.8', ARM) == expected


def test_sizes_follow_the_joint_unless_given():
    assert hidden('coulomb_friction', ARM) == Friction(1, LuGre(1.0))
    assert hidden('coulomb_friction:6', ARM).surfaces.coulomb == pytest.approx(0.3)


@pytest.mark.parametrize('name', sorted(KINDS))
def test_everything_by_name_changes_what_is_measured(name):
    def path(t):
        angle = np.outer(t, 0.1 * np.arange(2, 9))
        return 1.9 * np.sin(angle), np.cos(angle) * 0.19 * np.arange(2, 9), -np.sin(angle)

    motion = sample('sweep', path, 60.0, 20.0)
    still = Signals(motion.q, motion.qd, gravity_torque(ARM, motion.q))
    out = hidden(name, ARM).apply(still, motion, ARM, np.random.default_rng(0))
    change = np.abs(out.tau - still.tau).max() + np.abs(out.q - still.q).max()
    assert 0.005 < change < 100.0
    assert np.isfinite(out.tau).all() and np.isfinite(out.q).all()


@pytest.mark.parametrize('text, word', [
    ('gremlins', 'coulomb_friction'), ('coulomb_friction:9', 'no joint 9'),
    ('coulomb_friction:0', 'no joint 0'), ('coulomb_friction:4=much', 'not a number'),
    ('coulomb_friction=nan', 'not a number'), ('base_tilt:1', 'whole arm'),
    ('coulomb_friction:2=-1', '0 or more'),
])
def test_what_cannot_be_hidden_is_refused(text, word):
    with pytest.raises(OptionError, match=word):
        hidden(text, ARM)


def test_synth_hides_it_in_the_bag(tmp_path):
    def record(name, *more):
        assert main(['synth', '--motion', 'multisine', '--duration', '30', '--seed', '2', *more,
                     '-o', str(tmp_path / name)]) == 0
        return read_bag(tmp_path / name).samples

    plain = record('plain.mcap')
    rough = record('rough.mcap', '--hidden', 'coulomb_friction:4=0.8', '--hidden',
                   'torque_offset:1=-0.5')
    change = rough.tau - plain.tau
    moving = np.abs(plain.qd[:, 3]) > 0.02
    assert change[moving, 3] == pytest.approx(0.8 * np.sign(plain.qd[moving, 3]), abs=0.02)
    assert change[:, 0] == pytest.approx(-0.5)
    assert not change[:, [1, 2, 4, 5, 6]].any()


def test_synth_refuses_what_it_does_not_know(tmp_path, capsys):
    out = str(tmp_path / 'x.mcap')
    assert main(['synth', '--hidden', 'gremlins', '-o', out]) == 1
    assert main(['synth', '--static', '--hidden', 'detent', '-o', out]) == 1
    said = capsys.readouterr().err
    assert 'gremlins' in said and '--static' in said and 'Traceback' not in said
