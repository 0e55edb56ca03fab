"""Some of the faults of bench/node_faults, injected into the running node."""

from importlib import import_module

from bench.shared.ros_harness import running
from gravity_comp_ros.models.model_file import load_model
import pytest

pytest.importorskip('pinocchio')
client = import_module('bench.node_faults.client')
faults = import_module('bench.node_faults.faults')
FAULTS = {fault.name: fault for fault in faults.all_faults(1)}


@pytest.mark.parametrize('name', ['dead elbow, 60 samples, seed 0', '0.3 s without input, fade'])
def test_no_fault_causes_a_wrong_torque(name, iiwa_model_file):
    fault = FAULTS[name]
    with running({**client.PARAMETERS, 'model_file': iiwa_model_file, **fault.parameters}) as (
            node, probe):
        player = client.Player(probe, load_model(iiwa_model_file))
        problem = fault.play(player)
        player.check(name, fault.ramps)
        assert node.process.poll() is None
    assert not problem and not player.wrong


def test_the_campaign_has_at_least_eighty_faults():
    all_faults = faults.all_faults(3)
    assert len(all_faults) >= 80
    assert len(faults.KINDS) >= 12 and len(faults.LENGTHS) == 3
