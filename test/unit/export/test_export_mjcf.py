"""Export into an MJCF: MuJoCo loads it and gives the torque of the model."""

from dataclasses import replace
import re

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.export.mjcf_file import changed_mjcf
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np
import pytest

mujoco = pytest.importorskip('mujoco')

JOINTS = ('pan', 'lift', 'elbow')
# Angles in degrees, a body without a name, masses from shapes, a body that slides at the tip.
ARM = """<mujoco model="three">
  <compiler angle="degree"/>
  <!-- a comment with <body> in it -->
  <option gravity="0 0 -9.80665"/>
  <default><joint damping="0.5"/></default>
  <worldbody>
    <body name="table"><geom type="box" size="1 1 0.02" mass="30"/>
      <body name="turret" pos="0 0 0.3" euler="0 0 20">
        <joint name="pan" axis="0 0 1"/>
        <inertial pos="0 0.01 0" mass="3" diaginertia="0.02 0.02 0.01"/>
        <body pos="0 0.1 0.1" euler="0 90 0">
          <joint name="lift" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05" mass="4"/>
          <body name="fore" pos="0.4 0 0">
            <joint name="elbow" axis="0 1 0" frictionloss="0.1"/>
            <geom type="capsule" fromto="0 0 0 0.3 0.1 0" size="0.04" mass="2"/>
            <body name="finger" pos="0.3 0.1 0">
              <joint name="slide" type="slide" axis="1 0 0"/>
              <geom size="0.02" mass="0.2"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def mujoco_torque(path, q):
    """Return the gravity torque (M, 3) that holds the arm, by inverse dynamics."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, result = mujoco.MjData(model), []
    for row in q:
        for name, angle in zip(JOINTS, row):
            data.qpos[model.joint(name).qposadr[0]] = angle
        mujoco.mj_forward(model, data)
        result.append([data.qfrc_bias[model.joint(name).dofadr[0]] for name in JOINTS])
    return np.array(result)


def model_of(path, scale: float) -> GravityModel:
    """Return the energy of an arm in MuJoCo times a factor."""
    q = np.random.default_rng(0).uniform(-3, 3, (200, 3))
    tau, features = scale * mujoco_torque(path, q), np.arange(1, dictionary.n_features(3))
    columns = EnergyDesign(q, np.ones(q.shape)).columns(features)
    weights = np.linalg.lstsq(columns, tau.T.ravel(), rcond=None)[0]
    return GravityModel.from_energy(JOINTS, 'potential', Expansion(features, weights),
                                    np.full(3, 0.05), Coverage(np.full(3, -2.5), np.full(3, 2.5),
                                                               100), {})


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / 'arm.xml'
    path.write_text(ARM)
    return path


def test_mujoco_gives_the_torque_of_the_model(arm, tmp_path):
    model = model_of(arm, 1.3)
    model = replace(model, applied=Applied(
        (AppliedEffect('coulomb_friction', 'elbow', {'width': 0.01},
                       {'F_c': Value(0.7, '', (0.6, 0.8))}),
         AppliedEffect('viscous_friction', 'pan', {}, {'F_v': Value(2.0, '', (1.0, 3.0))}))))
    changed = changed_mjcf(arm, arm.read_bytes(), model)
    output = tmp_path / 'new.xml'
    output.write_bytes(changed.data)
    q = np.random.default_rng(2).uniform(-2.5, 2.5, (300, 3))
    expected = model.predict(q)
    deviation = np.abs(mujoco_torque(output, q) - expected).max(axis=0)
    assert (deviation < 2e-3 * np.abs(expected).max()).all()
    assert set(changed.links) == {'turret', 'body 3', 'fore', 'finger'}
    loaded = mujoco.MjModel.from_xml_path(str(output))
    assert loaded.joint('elbow').frictionloss[0] == 0.7 and loaded.joint('pan').damping[0] == 2.0
    assert (loaded.body_mass[1:] > 0).all()
    assert loaded.body('table').mass[0] == 30.0
    # The inertia about the centre of mass stays.
    original = mujoco.MjModel.from_xml_path(str(arm))
    np.testing.assert_allclose(loaded.body_inertia, original.body_inertia, rtol=1e-8)
    kept = re.sub(r'\n *<inertial[^>]*quat[^>]*/>', '', changed.data.decode())
    kept = kept.replace('frictionloss="0.7"', 'frictionloss="0.1"').replace(
        ' damping="2"', '', 1)
    turret = re.search(r'<inertial[^>]*>', kept)[0]
    assert kept.replace(turret, re.search(r'<inertial[^>]*>', ARM)[0]) == ARM


def test_an_unchanged_arm_stays_the_same(arm):
    changed = changed_mjcf(arm, arm.read_bytes(), model_of(arm, 1.0))
    for link in changed.links.values():
        assert link.mass == pytest.approx(link.mass_before, rel=1e-5)
        np.testing.assert_allclose(link.centre, link.centre_before, atol=1e-6)


@pytest.mark.parametrize(('change', 'message'), [
    (lambda t: t.replace('"elbow"', '"ellbow"'), 'has no joint elbow'),
    (lambda t: t.replace('name="lift"', 'name="lift" type="slide"'), 'lift is no hinge'),
    (lambda t: t.replace('angle="degree"', 'inertiafromgeom="true"'), 'replaces all masses'),
    (lambda t: t.replace('axis="0 1 0" f', 'axis="0 1 2" f'), 'names what differs'),
    (lambda t: t.replace('</worldbody>', ''), 'is not an MJCF'),
    (lambda t: t.replace('type="capsule"', 'type="cylindre"'), 'MuJoCo does not load'),
    (lambda t: '<robot/>', 'its root is <robot>')])
def test_a_bad_file_is_refused(arm, change, message):
    model = model_of(arm, 1.0)
    arm.write_text(change(ARM))
    with pytest.raises(GravityCompError, match=message):
        changed_mjcf(arm, arm.read_bytes(), model)


def test_bodies_of_included_files_are_refused(arm, tmp_path):
    model = model_of(arm, 1.0)
    start, end = ARM.index('    <body name="table"'), ARM.index('  </worldbody>')
    (tmp_path / 'body.xml').write_text(f'<mujoco>{ARM[start:end]}</mujoco>')
    arm.write_text(f'{ARM[:start]}<include file="body.xml"/>{ARM[end:]}')
    with pytest.raises(GravityCompError, match='includes'):
        changed_mjcf(arm, arm.read_bytes(), model)
