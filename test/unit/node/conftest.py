"""Nodes without ROS, a model of two joints, and the axes of the iiwa, for tests of the node."""

from pathlib import Path

from bench.shared.node_messages import motion, Nodes, torque
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.simulation.arms import iiwa7
import numpy as np
import pytest


@pytest.fixture(scope='session')
def nodes():
    nodes = Nodes()
    yield nodes
    nodes.end()


@pytest.fixture
def live(nodes):
    def make(**settings):
        return nodes.make(**{'unlimited_torque': True, 'max_age': 0.0, **settings})

    yield make
    nodes.close()


@pytest.fixture(scope='module')
def model_file(tmp_path_factory):
    t, q = motion(300)
    rng = np.random.default_rng(0)
    tau = torque(q) + 0.01 * rng.standard_normal(q.shape)
    path = tmp_path_factory.mktemp('live') / 'model.json'
    # Joints that do not load each other are no chain.
    save_model(path, fit(JointSamples.single_run(['a', 'b'], t, q, 0 * q, tau),
                         FitOptions(formulation='potential')).model)
    return path


@pytest.fixture(scope='session')
def geometry():
    """Return the axes of the iiwa in its description."""
    urdf = Path(__file__).resolve().parents[3] / 'bags' / 'iiwa7.urdf'
    return described_arm(urdf.read_bytes(), iiwa7().joints).geometry
