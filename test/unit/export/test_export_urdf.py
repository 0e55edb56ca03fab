"""Export into a URDF: the torque of the model, physical masses, every other byte unchanged."""

from dataclasses import replace
from pathlib import Path
import re

from bench.shared import urdf_snippets as snippets
from bench.shared.urdf_snippets import pinocchio_torque
from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.errors import DataError, GravityCompError, ModelMismatchError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.export.changed_description import Links, nearest_masses, NearestOptions
from gravity_comp_ros.export.urdf_file import changed_urdf
from gravity_comp_ros.export.xml_edit import number, XmlEdit
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain, expand
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np
import pinocchio as pin
import pytest

BAGS = Path(__file__).resolve().parents[3] / 'bags'
IIWA = (BAGS / 'iiwa7.urdf').read_bytes()
JOINTS = tuple(f'iiwa_joint_{n}' for n in range(1, 8))
NUMBER = re.compile(rb'(?<=")[-+0-9.e ]+(?=")')


def exact_model(urdf, joints, scale=1.0, coverage=2.0) -> GravityModel:
    """Return a chain on the axes of a URDF with the moments of its links times a factor."""
    arm = described_arm(urdf, joints)
    n = len(joints)
    q = np.random.default_rng(0).uniform(-2, 2, (200, n))
    tau = scale * pinocchio_torque(urdf, joints, q)
    zero = Chain(arm.geometry.rotations, np.zeros((n, 2)))
    columns = zero.jacobian(q)[2 * n:].transpose(2, 1, 0).reshape(-1, 2 * n)
    moments = np.linalg.lstsq(columns, tau.ravel(), rcond=None)[0].reshape(n, 2)
    chain = Chain(arm.geometry.rotations, moments)
    return GravityModel.from_energy(
        tuple(joints), 'chain', expand(chain), np.full(n, 0.05),
        Coverage(np.full(n, -coverage), np.full(n, coverage), 1000), {}, chain)


def without_numbers(data: bytes) -> bytes:
    return NUMBER.sub(b'#', data)


@pytest.mark.parametrize(('urdf', 'joints'), [
    (IIWA, JOINTS), (snippets.UR, snippets.UR_JOINTS),
    (snippets.PANDA, snippets.PANDA_JOINTS), (snippets.TIAGO, snippets.TIAGO_JOINTS),
    (snippets.BAXTER, [f'left_{part}' for part in snippets.BAXTER_PARTS])])
def test_columns_of_the_links_agree_with_pinocchio(urdf, joints):
    data = urdf if isinstance(urdf, bytes) else urdf.encode()
    arm = described_arm(data, joints)
    inertials = arm.inertials()
    q = np.random.default_rng(1).uniform(-2, 2, (20, len(joints)))
    torque = arm.columns(q, list(inertials)) @ np.concatenate(
        [inertial.about_origin()[:4] for inertial in inertials.values()])
    expected = pinocchio_torque(data, joints, q)
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-6)


def test_an_unchanged_arm_stays_the_same():
    changed = changed_urdf(IIWA, exact_model(IIWA, JOINTS))
    for link in changed.links.values():
        assert link.mass == pytest.approx(link.mass_before, rel=1e-5)
        np.testing.assert_allclose(link.centre, link.centre_before, atol=1e-6)


@pytest.mark.parametrize(('urdf', 'joints'), [
    (IIWA.decode(), JOINTS), (snippets.PANDA, snippets.PANDA_JOINTS),
    (snippets.UR, snippets.UR_JOINTS)])
def test_pinocchio_gives_the_torque_of_the_model(urdf, joints):
    data = urdf.encode()
    model = exact_model(data, joints, scale=1.25)
    changed = changed_urdf(data, model)
    q = np.random.default_rng(3).uniform(-2, 2, (300, len(joints)))
    expected = model.predict(q)
    largest = np.abs(expected).max(axis=0) + 1e-3 * np.abs(expected).max()
    deviation = np.abs(pinocchio_torque(changed.data, joints, q) - expected)
    assert (deviation.max(axis=0) / largest).max() < 2e-3
    assert all(changed.after[name] < 0.02 * changed.before[name]
               for name in joints if changed.before[name] > 0.1)
    assert without_numbers(changed.data) == without_numbers(data)
    assert all(link.mass > 0.0 for link in changed.links.values())


def test_a_fitted_model_with_two_kilograms_on_the_flange():
    samples = slow_samples(read_bag(BAGS / 'eq17_2kg.mcap').samples).samples
    geometry = described_arm(IIWA, samples.names).geometry
    for options in (FitOptions(formulation='chain', geometry=geometry),
                    FitOptions(formulation='chain')):
        model = fit(samples, options).model
        assert (model.geometry is None) == (options.geometry is None)
        changed = changed_urdf(IIWA, model)
        order = [model.joints.index(name) for name in geometry.joints]
        q = np.random.default_rng(3).uniform(model.coverage.q_min, model.coverage.q_max, (300, 7))
        deviation = pinocchio_torque(changed.data, geometry.joints, q[:, order]) \
            - model.predict(q)[:, order]
        assert np.sqrt((deviation ** 2).mean(axis=0)).max() < 0.1
        assert sum(x.mass - x.mass_before for x in changed.links.values()) > 0.5
        for body in pin.buildModelFromXML(changed.data.decode()).inertias[1:]:
            moments = np.linalg.eigvalsh(body.inertia)
            assert body.mass > 0.0 and moments[0] > 0.0
            assert moments[0] + moments[1] >= moments[2] * (1 - 1e-9)


def test_only_numbers_of_mass_and_origin_change_byte_for_byte():
    text = ('\n<?xml version="1.0" ?>\r\n<!-- arm > 1 -->\n<robot name="r">\n'
            '\t<link name="base"/>\n\t<joint name="a" type="revolute">\n'
            '\t\t<parent link="base"/><child link="l"/><axis xyz="0 1 0"/>\n'
            '\t\t<limit lower="-3" upper="3" effort="9" velocity="2"/>\n\t</joint>\n'
            '\t<link name="l">\n\t\t<inertial>\n\t\t\t<!-- guess -->\n'
            "\t\t\t<mass value = '2.0' />\n"
            '\t\t\t<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>\n'
            '\t\t</inertial>\n\t</link>\n</robot>\n\n')
    # A point mass of 3 kg at (0.1, 0, 0.2) turns by y: energy 3 g (-0.1 sin q + 0.2 cos q).
    energy = 3.0 * STANDARD_GRAVITY * np.array([-0.1, 0.2])
    from gravity_comp_ros.models.sparse.dictionary import Expansion
    model = GravityModel.from_energy(('a',), 'potential', Expansion(np.array([1, 2]), energy),
                                     np.array([0.01]), Coverage([-2.0], [2.0], 100), {})
    model = replace(model, applied=Applied(
        (AppliedEffect('coulomb_friction', 'a', {'width': 0.01},
                       {'F_c': Value(0.25, 'N·m', (0.2, 0.3))}),
         AppliedEffect('torque_offset', 'a', {}, {'b': Value(0.1, 'N·m', (0.0, 0.2))}))))
    changed = changed_urdf(text.encode(), model)
    link = changed.links['l']
    np.testing.assert_allclose(link.mass * np.array(link.centre), [0.3, 0.0, 0.6], atol=1e-3)
    expected = text.replace("'2.0'", f"'{link.mass:.10g}'")
    xyz = ' '.join(map(number, link.centre))
    expected = expected.replace('<inertial>\n', '<inertial>\n\t\t\t'
                                f'<origin xyz="{xyz}" rpy="0 0 0"/>\n')
    expected = expected.replace('type="revolute">\n', 'type="revolute">\n\t\t'
                                '<dynamics friction="0.25"/>\n')
    assert changed.data.decode() == expected
    assert changed.effects == ('coulomb_friction:a',)
    assert list(changed.left_out) == ['torque_offset:a']


def test_the_nearest_masses_by_hand():
    # One body on a horizontal axis: only the first moment counts. With S0 = s 1, the divergence
    # (m/m0 - ln(m/m0) - 1) + m |c|^2 / s at fixed m c = h is least where
    # 1/m0 - 1/m - h^2/(s m^2) = 0.
    m0, s, h = 2.0, 0.05, 0.3
    links = Links(('l',), np.array([m0]), np.zeros((1, 3)), s * np.eye(3)[None])
    q = np.linspace(-2, 2, 50)[:, None]
    regressor = np.stack([np.zeros_like(q), np.sin(q), np.zeros_like(q), np.cos(q)], axis=-1)
    torque = h * np.sin(q)
    x = nearest_masses(links, regressor, torque, np.zeros(1), ('a',), np.zeros((0, *torque.shape)),
                       NearestOptions(tolerance=1e-6, min_radius=1e-9))
    mass = (m0 + np.sqrt(m0 ** 2 + 4.0 * m0 * h ** 2 / s)) / 2.0
    assert x[0] == pytest.approx(mass, rel=1e-4)
    np.testing.assert_allclose(x[1:] / x[0], [h / mass, 0.0, 0.0], atol=1e-5)


def test_gravity_that_is_not_separated_from_a_spring_changes_no_mass():
    """The model has 15 N·m too much gravity, and a spring that holds as much less."""
    exact = exact_model(IIWA, JOINTS)
    wrong = exact.chain.moments.copy()
    wrong[1, 1] += 15.0
    std = np.full(28, 1e-4)
    std[14 + 3] = 8.0
    spring = AppliedEffect('joint_spring', JOINTS[1], {'centre': 0.0, 'overtones': 0.0}, {
        'k': Value(-15.0, 'N·m/rad', (-31.0, 1.0)), 'm': Value(0.0, 'N·m', (-1.0, 1.0))})
    chain = Chain(exact.chain.axes, wrong)
    model = replace(exact, chain=chain, energy=expand(chain), torques=(),
                    covariance=np.diag(std ** 2), applied=Applied((spring,)))
    changed = changed_urdf(IIWA, model)
    for link in changed.links.values():
        assert link.mass == pytest.approx(link.mass_before, rel=0.05)
        np.testing.assert_allclose(link.centre, link.centre_before, atol=2e-3)
    assert changed.uncertain == (JOINTS[1],)
    # Without a larger mass the torque of a model with that much gravity is not reached.
    sure = changed_urdf(IIWA, replace(model, covariance=np.diag(1e-8 * np.ones(28)),
                                      applied=Applied()))
    assert max(abs(link.mass / link.mass_before - 1.0) for link in sure.links.values()) > 0.3
    assert not sure.uncertain


def test_a_model_of_an_arm_with_other_joints_or_axes_is_refused():
    model = exact_model(IIWA, JOINTS)
    with pytest.raises(ModelMismatchError, match='has no joint'):
        changed_urdf(snippets.PANDA.encode(), model)
    turned = re.sub(rb'rpy="1\.5707[^"]*"', b'rpy="0.4 0.3 0"', IIWA)
    assert turned != IIWA
    with pytest.raises(ModelMismatchError, match='names what differs'):
        changed_urdf(turned, model)
    before, joint, after = IIWA.partition(b'<joint name="iiwa_joint_4"')
    reversed_axis = before + joint + after.replace(b'xyz="0 0 1"', b'xyz="0 0 -1"', 1)
    for each in (model, replace(model, geometry=described_arm(IIWA, JOINTS).geometry)):
        with pytest.raises(ModelMismatchError, match='iiwa_joint_4.*check --urdf'):
            changed_urdf(reversed_axis, each)


@pytest.mark.parametrize(('change', 'message'), [
    (lambda t: re.sub(r'<inertial>.*?</inertial>', '', t, flags=re.DOTALL), 'gives no mass'),
    (lambda t: t.replace('<mass value="1.5"/>', '<mass value="heavy"/>'), 'not a number'),
    (lambda t: t.replace('<mass value="1.5"/>', '<mass value="-1"/>'), 'mass of -1 kg'),
    (lambda t: t[:len(t) // 2], 'is not a URDF')])
def test_a_bad_description_is_refused(change, message):
    model = exact_model(snippets.UR, snippets.UR_JOINTS)
    with pytest.raises(GravityCompError, match=message):
        changed_urdf(change(snippets.UR).encode(), model)


def test_utf16_is_refused():
    with pytest.raises(DataError, match='UTF-16'):
        XmlEdit('<robot/>'.encode('utf-16'), 'r.urdf')


def test_an_impossible_inertia_is_repaired_and_named():
    text = snippets.UR.replace('ixx="0.1" iyy="0.1" izz="0.1"', 'ixx="0.1" iyy="0.1" izz="0.5"')
    changed = changed_urdf(text.encode(), exact_model(text, snippets.UR_JOINTS))
    assert [note.split()[1] for note in changed.notes] == [f'{name}:' for name in changed.links]
    assert all('triangle inequality' in note for note in changed.notes)
    for body in pin.buildModelFromXML(changed.data.decode()).inertias[1:]:
        moments = np.linalg.eigvalsh(body.inertia)
        assert moments[0] + moments[1] >= moments[2] * (1 - 1e-9)
