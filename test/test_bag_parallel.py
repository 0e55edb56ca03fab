"""Bags read in worker processes: same results, order and errors."""

from functools import partial

from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings import parallel
from gravity_comp_ros.recordings.gated_bag import read_gated
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.recordings.parallel import in_processes, read_gated_bags, workers
import numpy as np
import pytest
from recordings import motion, NAMES

GATE = GateOptions(max_speed=2.0)


@pytest.fixture
def bags(tmp_path):
    paths = []
    for number in range(3):
        t, q, qd, tau = motion(100 + number)
        write_bag(tmp_path / f'{number}.mcap', [JointTopic('/joint_states', NAMES, t, q, qd, tau)])
        paths.append(tmp_path / f'{number}.mcap')
    return paths


def test_worker_processes_give_equal_results(bags):
    read = partial(read_gated, gate=GATE)
    here, there = list(in_processes(read, bags, 1)), list(in_processes(read, bags, 2))
    assert [result.report.n_messages for result in there] == [100, 101, 102]
    for a, b in zip(here, there):
        assert (a.report, a.dropped) == (b.report, b.dropped)
        np.testing.assert_array_equal(a.samples.tau, b.samples.tau)


def test_errors_of_a_worker_are_raised_unchanged(bags, monkeypatch):
    monkeypatch.setattr(parallel, 'workers', lambda paths: 2)
    bags[1].write_bytes(b'')
    result = read_gated_bags(bags, gate=GATE)
    assert next(result).report.n_messages == 100
    with pytest.raises(BagError, match='1.mcap is empty'):
        next(result)


def test_small_bags_are_read_in_one_process(bags, tmp_path):
    assert workers(bags) == 1
    assert workers([tmp_path / 'missing.mcap', *bags]) == 1
