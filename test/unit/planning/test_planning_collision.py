"""Self-collision check with the collision geometry of a description."""

from bench.shared.planning_arm import model, NAMES, one_way
from gravity_comp_ros.cli import main
from gravity_comp_ros.errors import GravityCompError, OptionError
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.planning import plan, PlanOptions, Target
from gravity_comp_ros.planning.collision import (
    arm_limits, CollisionsUnchecked, MARGIN, self_collision)
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.recordings.trajectory_files import read_trajectory
import numpy as np
import pytest

pytest.importorskip('pinocchio')
TARGET = [Target('coulomb_friction', 'elbow')]


def link(name: str, shape: str = '', x: float = 0.2) -> str:
    box = f'<collision><origin xyz="{x} 0 0"/><geometry>{shape}</geometry></collision>'
    return f'<link name="{name}">{box if shape else ""}</link>'


def joint(name: str, parent: str, child: str, x: float, kind: str = 'revolute') -> str:
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{x} 0 0"/><axis xyz="0 1 0"/>'
            f'<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>')


def planar(shape: str = '<box size="0.3 0.04 0.04"/>', *more: str, kind: str = 'revolute') -> str:
    """Return three links of 0.4 m in a row, each with a shape of 0.3 m in its middle."""
    return ('<robot name="r">' + link('base') + link('one', shape) + link('two', shape)
            + link('three', shape) + joint(NAMES[0], 'base', 'one', 0.0)
            + joint(NAMES[1], 'one', 'two', 0.4, kind) + joint(NAMES[2], 'two', 'three', 0.4)
            + ''.join(more) + '</robot>')


def wall(z: float) -> str:
    """Return a wall fixed to the base, 0.1 m thick, at height z in m."""
    return (f'<link name="wall"><collision><origin xyz="0.9 0 {z}"/><geometry>'
            f'<box size="0.6 1 0.1"/></geometry></collision></link>'
            f'<joint name="stands" type="fixed"><parent link="base"/><child link="wall"/></joint>')


def folded() -> np.ndarray:
    """Return a straight pose and one in which the last link lies on the first."""
    return np.array([[0.0, 0.0, 0.0], [0.0, 2.6, 2.6]])


@pytest.mark.parametrize('kind', ['revolute', 'continuous'])
def test_a_folded_arm_hits_itself(kind):
    check = self_collision(planar(kind=kind), NAMES, np.zeros((3, 3)))
    assert [len(pairs) for pairs in check.colliding(folded())] == [0, 1]
    assert check.hits(folded()) and not check.hits(folded()[:1]) and not check.overlapping
    # Neighbours may touch: the elbow alone cannot collide.
    assert not check.hits(np.array([[0.0, 3.1, 0.0]]))


def test_the_margin():
    # The wall's lower face is at 0.2 m; a level arm reaches up to 0.02 m.
    for below, hit in ((0.99, True), (1.01, False)):
        urdf = planar('<box size="0.3 0.04 0.04"/>', wall(0.02 + below * MARGIN + 0.05))
        check = self_collision(urdf, NAMES, np.array([[0.5, 0.0, 0.0]]))
        assert check.hits(np.zeros((1, 3))) is hit


def test_links_that_touch_in_recorded_poses_are_excluded():
    check = self_collision(planar(), NAMES, folded())
    assert check.overlapping == ('one_0 and three_0',) and not check.hits(folded())


@pytest.mark.parametrize('urdf, message', [
    (planar(''), 'no collision geometry'),
    (planar().replace('elbow', 'knee'), 'no moving joint elbow'),
    (planar('<mesh filename="package://arm/link.stl"/>'), 'link.stl could not be found'),
    ('<robot', 'XML')])
def test_the_reason_of_a_missing_check_is_one_line(urdf, message, tmp_path):
    with pytest.raises(CollisionsUnchecked, match=message) as caught:
        self_collision(urdf, NAMES, np.zeros((1, 3)), tmp_path)
    assert '\n' not in str(caught.value)
    path = tmp_path / 'arm.urdf'
    path.write_text(urdf)
    if 'no moving joint' in message or message == 'XML':
        # A description that the user names must match.
        with pytest.raises(GravityCompError, match='no joint elbow|not a URDF'):
            arm_limits(path, [], NAMES, np.zeros((1, 3)))
        return
    limits = arm_limits(path, [], NAMES, np.zeros((1, 3)))
    assert limits.check is None and limits.positions is not None
    assert limits.note.startswith('not checked') and message in limits.note


def test_a_plan_avoids_collisions():
    # A positive angle rotates the arm down, towards the wall.
    old = one_way(0)
    deep = old.q[:, 0] + 0.5 * old.q[:, 1]
    above = old.select(deep < 0.1)
    check = self_collision(planar('<box size="0.3 0.04 0.04"/>', wall(-0.3)), NAMES, above.q)
    # A cable is identified by the range on both sides of its start.
    target = [Target('cable_stiffness', 'shoulder')]
    free = plan(old, model(), target, PlanOptions(15.0))
    number = next(k for k, q in enumerate(free.trajectory.q) if check.hits(q))
    assert not check.hits(above.q)
    options = PlanOptions(15.0, start=above.q[-1])
    kept = plan(old, model(), target, options, obstacles=check)
    between = 0.5 * (kept.trajectory.q[1:] + kept.trajectory.q[:-1])
    assert not check.hits(np.vstack([kept.trajectory.q, between]))
    with pytest.raises(OptionError, match='at the start pose the arm hits itself'):
        plan(old, model(), TARGET, PlanOptions(15.0, start=free.trajectory.q[number]),
             obstacles=check)


def test_the_command_reports_the_check(tmp_path, capsys):
    write_bag(tmp_path / 'old.mcap', [joint_states(one_way(0))])
    save_model(tmp_path / 'arm.json', model())
    (tmp_path / 'arm.urdf').write_text(planar())
    line = ['plan', str(tmp_path / 'old.mcap'), '--model', str(tmp_path / 'arm.json'),
            '--settle', 'coulomb_friction:elbow', '--duration', '8',
            '-o', str(tmp_path / 'motion.csv')]
    assert main(line) == 0
    assert 'not checked whether the links' in ' '.join(capsys.readouterr().out.split())
    assert main([*line, '--urdf', str(tmp_path / 'arm.urdf')]) == 0
    output = ' '.join(capsys.readouterr().out.split())
    assert f'collision geometry of {tmp_path / "arm.urdf"}' in output
    assert read_trajectory(tmp_path / 'motion.csv').joints == NAMES
