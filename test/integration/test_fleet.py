"""Fleets in one process, in several, and on a Dask cluster with a killed worker."""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

from bench.shared.fleet_tasks import DEADLINE, die_of, die_once, process_id, until_killed
from bench.shared.running_process import is_running
from bench.shared.serial_arms import poses, samples_of, serial_arm
from gravity_comp_ros import cli
from gravity_comp_ros.errors import BagError, DataError
from gravity_comp_ros.fleet.engine import Engine, Failure
from gravity_comp_ros.fleet.folder import find_robots, Robot
from gravity_comp_ros.fleet.run import CACHE, FleetRun
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def fleet(tmp_path):
    """Return a folder of two robots with three bags each, one of them damaged."""
    folder = tmp_path / 'fleet'
    for seed, robot in enumerate(('anna', 'bert')):
        arm = serial_arm(3, seed=seed)
        (folder / robot).mkdir(parents=True)
        for run in range(3):
            q = poses(60, 3, seed=10 * seed + run)
            write_bag(folder / robot / f'run{run}.mcap',
                      [joint_states(samples_of(q, gravity_torque(arm, q), 0.05))])
    (folder / 'bert' / 'run1.mcap').write_bytes(b'\x89MCAP0\r\nno more')
    return folder


def weights(folder: Path) -> dict:
    return {path.name: [(t.indices.tolist(), t.weights.tolist()) for t in
                        load_model(path).torques] for path in sorted(folder.glob('*.json'))}


def run(fleet, output, engine=Engine()):
    return FleetRun(find_robots(fleet), output, engine).fit()


def test_layout_of_the_fleet_folder(fleet, tmp_path):
    robots = find_robots(fleet)
    assert [(robot.name, [bag.name for bag in robot.bags]) for robot in robots] == [
        (name, ['run0.mcap', 'run1.mcap', 'run2.mcap']) for name in ('anna', 'bert')]
    assert find_robots(fleet / 'anna') == [Robot('anna', robots[0].bags)]
    (tmp_path / 'empty').mkdir()
    with pytest.raises(BagError, match='contains no recording'):
        find_robots(tmp_path / 'empty')
    with pytest.raises(BagError, match='cannot read the fleet'):
        find_robots(tmp_path / 'nowhere')


def test_a_failed_bag_is_reported_and_skipped(fleet, tmp_path):
    outcome = run(fleet, tmp_path / 'out')
    assert set(outcome.robots) == {'anna', 'bert'}
    (bag,) = outcome.failed_bags
    assert bag.endswith('bert/run1.mcap') and 'truncated' in outcome.failed_bags[bag]
    assert [outcome.robots[name].bags for name in ('anna', 'bert')] == [3, 2]
    arm, q = serial_arm(3, seed=0), poses(100, 3, seed=99)
    model = load_model(tmp_path / 'out' / 'anna.json')
    assert np.sqrt(((model.predict(q) - gravity_torque(arm, q)) ** 2).mean(axis=0)).max() < 0.05
    assert [bag['name'] for bag in model.provenance['bags']] == [
        'run0.mcap', 'run1.mcap', 'run2.mcap']


def test_worker_processes_give_equal_models(fleet, tmp_path):
    run(fleet, tmp_path / 'one')
    run(fleet, tmp_path / 'two', Engine(workers=2))
    assert weights(tmp_path / 'two') == weights(tmp_path / 'one')


def test_completed_work_is_resumed(fleet, tmp_path):
    first = run(fleet, tmp_path / 'out')
    assert first.resumed == 0
    second = run(fleet, tmp_path / 'out')
    assert second.resumed == 5 + 2 and second.robots == first.robots
    assert len(second.failed_bags) == 1            # failures are tried again
    (tmp_path / 'out' / 'anna.json').write_text('damaged')
    q = poses(60, 3, seed=7)
    write_bag(fleet / 'bert' / 'run3.mcap', [joint_states(samples_of(
        q, gravity_torque(serial_arm(3, seed=1), q), 0.05))])
    third = run(fleet, tmp_path / 'out')
    assert third.resumed == 5 and third.robots['bert'].bags == 3
    assert weights(tmp_path / 'out')['anna.json']


def test_a_damaged_cache_is_ignored(fleet, tmp_path):
    run(fleet, tmp_path / 'out')
    before = weights(tmp_path / 'out')
    for file in (tmp_path / 'out' / CACHE).iterdir():
        file.write_bytes(file.read_bytes()[:100])
    assert run(fleet, tmp_path / 'out').resumed == 0
    assert weights(tmp_path / 'out') == before


def test_tasks_of_a_dead_worker_are_repeated(tmp_path):
    items = ['', str(tmp_path / 'died'), '', '']
    assert dict(Engine(workers=2).run(die_once, items)) == dict(enumerate(items))


def test_a_task_that_kills_every_worker_fails():
    results = dict(Engine(workers=2).run(die_of, ['x', 'kill', 'y']))
    assert (results[0], results[2]) == ('x', 'y')
    assert isinstance(results[1], Failure) and 'died 3 times' in results[1].reason


def test_workers_that_die_at_once_fail_their_own_tasks_alone():
    words = ['kill', 'a', 'b', 'kill', 'c', 'd']
    results = dict(Engine(workers=3).run(die_of, words))
    assert {k: r for k, r in results.items() if not isinstance(r, Failure)} == {
        k: word for k, word in enumerate(words) if word != 'kill'}
    assert sorted(results) == list(range(6))


def test_no_worker_is_left_when_results_are_no_longer_wanted():
    results = Engine(workers=2).run(process_id, range(4))
    _, worker = next(results)
    assert is_running(worker)
    results.close()
    assert not is_running(worker)


def test_other_tasks_go_on_after_an_error():
    results = dict(Engine().run(int, ['1', 'x', '3']))
    assert (results[0], results[2]) == (1, 3) and 'ValueError' in results[1].reason
    (failure,) = dict(Engine().run(Robot, [None])).values()
    assert isinstance(failure, Failure)


# A Dask cluster in separate processes.

def start(*command: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, '-m', *command], stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE, text=True,
                            env={**os.environ, 'PYTHONPATH': f'{ROOT}',
                                 'OPENBLAS_NUM_THREADS': '1',
                                 'DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL': '60s'})


@pytest.fixture(scope='module')
def running():
    """Yield the address of a scheduler, and its workers by name, initially none."""
    pytest.importorskip('distributed')
    scheduler = start('distributed.cli.dask_scheduler', '--host', '127.0.0.1', '--port', '0',
                      '--no-dashboard')
    workers: dict[str, subprocess.Popen] = {}
    try:
        yield next(line.rsplit(' ', 1)[-1].strip() for line in scheduler.stderr
                   if 'Scheduler at:' in line), workers
    finally:
        for process in (scheduler, *workers.values()):
            process.kill()
            process.wait()
            process.stderr.close()


@pytest.fixture
def cluster(running):
    """Yield the address of a scheduler with two workers, and the workers; replace killed ones."""
    from distributed import Client
    address, workers = running
    living = [name for name in workers if workers[name].poll() is None]
    for number in range(len(workers), len(workers) + 2 - len(living)):
        name = f'worker{number}'
        workers[name] = start('distributed.cli.dask_worker', address, '--nthreads', '1',
                              '--no-nanny', '--no-dashboard', '--name', name)
        living.append(name)
    with Client(address, timeout=DEADLINE, set_as_default=False) as client:
        end = time.monotonic() + DEADLINE
        while known_workers(client) != set(living) and time.monotonic() < end:
            time.sleep(0.02)
    return address, {name: workers[name] for name in living}


def known_workers(client) -> set[str]:
    return {worker['name'] for worker in client.scheduler_info()['workers'].values()}


def kill_working_worker(log: Path, workers: dict, killed: list) -> None:
    """Kill the first worker that has started a task, and notify the others."""
    end = time.monotonic() + DEADLINE
    while not killed and time.monotonic() < end:
        working = set(log.read_text().split()) if log.exists() else set()
        killed += [worker for worker in workers.values() if str(worker.pid) in working][:1]
        time.sleep(0.01)
    killed[0].send_signal(signal.SIGKILL)
    killed[0].wait(DEADLINE)
    Path(f'{log}.killed').touch()


def test_a_dask_cluster_gives_equal_models(fleet, tmp_path, cluster):
    address, _ = cluster
    run(fleet, tmp_path / 'one')
    outcome = run(fleet, tmp_path / 'dask', Engine(scheduler=address))
    assert weights(tmp_path / 'dask') == weights(tmp_path / 'one')
    assert len(outcome.failed_bags) == 1 and not outcome.failed_robots


def test_a_dask_worker_killed_during_a_run(tmp_path, cluster):
    address, workers = cluster
    log, killed = tmp_path / 'log', []
    killer = threading.Thread(target=kill_working_worker, args=(log, workers, killed))
    killer.start()
    results = dict(Engine(scheduler=address).run(until_killed, [str(log)] * 20))
    killer.join()
    begun = [int(line) for line in log.read_text().split()]
    assert killed[0].returncode == -signal.SIGKILL and killed[0].pid in begun
    (survivor,) = set(workers.values()) - set(killed)
    assert set(results) == set(range(20)) and set(results.values()) == {survivor.pid}
    assert len(begun) > 20                          # the lost task was repeated


def kill_fitting_worker(address: str, workers: dict, killed: list) -> None:
    """Kill the first worker that runs a fit."""
    import distributed
    end = time.monotonic() + DEADLINE
    with distributed.Client(address, timeout=DEADLINE, set_as_default=False) as client:
        while not killed and time.monotonic() < end:
            for worker, stacks in client.call_stack().items():
                if 'fit_robot' in repr(stacks):
                    name = client.scheduler_info()['workers'][worker]['name']
                    killed.append(workers[name])
                    killed[0].send_signal(signal.SIGKILL)
                    return


def test_a_dask_worker_killed_during_a_fit(tmp_path, cluster):
    address, workers = cluster
    for robot in range(4):
        (tmp_path / 'fleet' / f'r{robot}').mkdir(parents=True)
        q = poses(400, 6, seed=robot)
        tau = gravity_torque(serial_arm(6, seed=robot), q)
        write_bag(tmp_path / 'fleet' / f'r{robot}' / 'run.mcap',
                  [joint_states(samples_of(q, tau, 0.05))])
    killed: list[subprocess.Popen] = []
    killer = threading.Thread(target=kill_fitting_worker, args=(address, workers, killed))
    killer.start()
    outcome = FleetRun(find_robots(tmp_path / 'fleet'), tmp_path / 'dask',
                       Engine(scheduler=address)).fit()
    killer.join()
    assert killed and killed[0].wait(timeout=DEADLINE) == -signal.SIGKILL
    assert len(outcome.robots) == 4 and not outcome.failed_robots
    run(tmp_path / 'fleet', tmp_path / 'one')
    assert weights(tmp_path / 'dask') == weights(tmp_path / 'one')


def test_a_missing_scheduler_is_refused(fleet, tmp_path, monkeypatch):
    pytest.importorskip('distributed')
    from gravity_comp_ros.fleet import engine
    monkeypatch.setattr(engine, '_CONNECT', 1.0)
    with pytest.raises(DataError, match='no Dask scheduler answers') as error:
        run(fleet, tmp_path / 'out', Engine(scheduler='tcp://127.0.0.1:1'))
    assert '\n' not in str(error.value)


def test_the_command_fits_and_diagnoses(fleet, tmp_path, capsys):
    models = tmp_path / 'models'
    assert cli.main(['fleet', 'fit', str(fleet), '-o', str(models), '--workers', '1',
                     '--json']) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed['robots']) == {'anna', 'bert'} and len(printed['failed_bags']) == 1
    assert cli.main(['fleet', 'diagnose', str(fleet / 'anna'), '-o', str(tmp_path / 'found'),
                     '--models', str(models), '--workers', '1']) == 0
    assert 'anna.diagnosis.json' in capsys.readouterr().out
    results = json.loads((tmp_path / 'found' / 'anna.diagnosis.json').read_text())
    assert {'findings', 'joints'} <= set(results)
    assert cli.main(['fleet', 'diagnose', str(fleet / 'anna'), '-o', str(tmp_path / 'found'),
                     '--models', str(models), '--workers', '1', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['resumed'] == 1
