"""Fleets on a cluster of this machine, and on that of a Dask scheduler with TLS."""

import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import threading

from bench.shared.serial_arms import poses, samples_of, serial_arm
import dask
from gravity_comp_ros import cli
from gravity_comp_ros.api.axes import ArmOptions
from gravity_comp_ros.errors import BagError, DataError
from gravity_comp_ros.fleet import run as fleet_run
from gravity_comp_ros.fleet.run import (
    CACHE, ClusterOptions, find_robots, FleetOptions, run_fleet, run_tasks)
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest


@pytest.fixture
def fleet(tmp_path):
    """Return a folder of two robots with three bags each, one of them damaged."""
    folder = tmp_path / 'fleet'
    for seed, robot in enumerate(('anna', 'bert')):
        arm = serial_arm(3, seed=seed)
        (folder / robot).mkdir(parents=True)
        for number in range(3):
            write(folder / robot / f'run{number}.mcap', arm, 10 * seed + number)
    (folder / 'bert' / 'run1.mcap').write_bytes(b'\x89MCAP0\r\nno more')
    return folder


def write(path, arm, seed):
    q = poses(60, 3, seed=seed)
    write_bag(path, [joint_states(samples_of(q, gravity_torque(arm, q), 0.05))])


def weights(folder: Path) -> dict:
    return {path.name: [(t.indices.tolist(), t.weights.tolist()) for t in
                        load_model(path).torques] for path in sorted(folder.glob('*.json'))}


def fit(fleet, output, where=ClusterOptions()):
    options = FleetOptions('fit', learning=ArmOptions('potential'))
    return run_fleet(find_robots(fleet), output, options, where)


def test_layout_of_the_fleet_folder(fleet, tmp_path):
    robots = find_robots(fleet)
    assert [(name, [bag.name for bag in bags]) for name, bags in robots.items()] == [
        (name, ['run0.mcap', 'run1.mcap', 'run2.mcap']) for name in ('anna', 'bert')]
    assert find_robots(fleet / 'anna') == {'anna': robots['anna']}
    (tmp_path / 'empty').mkdir()
    with pytest.raises(BagError, match='contains no recording'):
        find_robots(tmp_path / 'empty')
    with pytest.raises(BagError, match='cannot read the fleet'):
        find_robots(tmp_path / 'nowhere')
    (fleet / 'bert').rename(fleet / 'anna.diagnosis')
    with pytest.raises(BagError, match='rename its folder'):
        find_robots(fleet)


class ExpiresAt10(threading.Event):
    """An event on which no call waits that waits for 10 s, as on a busy machine."""

    def wait(self, timeout=None):
        return super().wait(None if timeout != 10 else 0.0)


def test_every_robot_is_fitted_and_a_damaged_bag_is_named(fleet, tmp_path, monkeypatch):
    """Processes give the models of a single thread; the event loop may start late."""
    monkeypatch.setattr('threading.Event', ExpiresAt10)
    outcome = fit(fleet, tmp_path / 'out')
    (bag,) = outcome.failed_bags
    assert bag.endswith('bert/run1.mcap') and 'truncated' in outcome.failed_bags[bag]
    assert {name: entry['bags'] for name, entry in outcome.robots.items()} == {
        'anna': 3, 'bert': 2}
    arm, q = serial_arm(3, seed=0), poses(100, 3, seed=99)
    model = load_model(tmp_path / 'out' / 'anna.json')
    assert np.sqrt(((model.predict(q) - gravity_torque(arm, q)) ** 2).mean(axis=0)).max() < 0.05
    assert [bag['name'] for bag in model.provenance['bags']] == [
        'run0.mcap', 'run1.mcap', 'run2.mcap']
    fit(fleet, tmp_path / 'two', ClusterOptions(workers=2))
    assert weights(tmp_path / 'two') == weights(tmp_path / 'out')


def test_completed_work_is_resumed(fleet, tmp_path, monkeypatch):
    first, before = fit(fleet, tmp_path / 'out'), weights(fleet)
    second = fit(fleet, tmp_path / 'out')
    assert (first.resumed, second.resumed) == (0, 2)
    assert (second.robots, second.failed_bags) == (first.robots, first.failed_bags)
    # Another model under the name of a robot, or a new bag, is no result of this fit.
    shutil.copy(tmp_path / 'out' / 'bert.json', tmp_path / 'out' / 'anna.json')
    assert fit(fleet, tmp_path / 'out').resumed == 1
    write(fleet / 'bert' / 'run3.mcap', serial_arm(3, seed=1), 7)
    third = fit(fleet, tmp_path / 'out')
    assert third.resumed == 1 and third.robots['bert']['bags'] == 3
    # Nor is the result of another version of this package, or a damaged one.
    monkeypatch.setattr(fleet_run, '__version__', '0.0.0')
    assert fit(fleet, tmp_path / 'out').resumed == 0
    for file in (tmp_path / 'out' / CACHE).iterdir():
        file.write_bytes(file.read_bytes()[:100])
    assert fit(fleet, tmp_path / 'out').resumed == 0
    assert weights(fleet) == before


def die_of(word: str) -> str:
    if word == 'kill':
        os.kill(os.getpid(), signal.SIGKILL)
    if word == 'error':
        raise ValueError('two\nlines')
    return word


def test_other_tasks_go_on_after_an_error_and_the_death_of_workers():
    words = ['a', 'kill', 'b', 'error', 'c']
    with dask.config.set({'distributed.scheduler.allowed-failures': 1}):
        results = {number: (result, reason) for number, result, reason in run_tasks(
            ClusterOptions(workers=2), die_of, words)}
    assert [results[k] for k in (0, 2, 4)] == [(words[k], '') for k in (0, 2, 4)]
    assert 'died' in results[1][1]
    assert results[3][1] == 'internal error: ValueError: two lines'


@pytest.fixture
def tls(tmp_path):
    """Return the configuration of Dask with the files of a certificate authority, and of a key."""
    if shutil.which('openssl') is None:
        pytest.skip('openssl is not installed')
    files = tuple(tmp_path / name for name in ('ca.pem', 'cert.pem', 'key.pem'))
    authority, certificate, key = map(str, files)

    def openssl(*command):
        subprocess.run(('openssl', *command), check=True, capture_output=True)

    new = ('req', '-newkey', 'rsa:2048', '-nodes', '-subj')
    openssl(*new, '/CN=authority', '-x509', '-keyout', f'{tmp_path}/ca-key.pem', '-out', authority)
    openssl(*new, '/CN=fleet', '-keyout', key, '-out', f'{tmp_path}/request.pem')
    openssl('x509', '-req', '-in', f'{tmp_path}/request.pem', '-CA', authority, '-CAkey',
            f'{tmp_path}/ca-key.pem', '-CAcreateserial', '-out', certificate)
    return {'distributed.comm.tls.ca-file': authority, **{
        f'distributed.comm.tls.{role}.{name}': file for role in ('scheduler', 'worker', 'client')
        for name, file in (('cert', certificate), ('key', key))}}


def test_a_cluster_with_tls_gives_equal_models_and_refuses_others(
        fleet, tmp_path, tls, monkeypatch):
    """Scheduler and worker are separate processes, as on several machines."""
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1', **{
        'DASK_' + name.upper().replace('.', '__').replace('-', '_'): file
        for name, file in tls.items()}}

    def start(*command):
        return subprocess.Popen([sys.executable, '-m', *command, '--no-dashboard'],
                                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                                env=environment)

    scheduler = start('distributed.cli.dask_scheduler', '--host', 'tls://127.0.0.1', '--port', '0')
    processes = [scheduler]
    try:
        address = next(line.rsplit(' ', 1)[-1].strip() for line in scheduler.stderr
                       if 'Scheduler at:' in line)
        processes.append(start('distributed.cli.dask_worker', address, '--nthreads', '1',
                               '--no-nanny'))
        where = ClusterOptions(scheduler=address)
        with dask.config.set(tls):
            outcome = fit(fleet, tmp_path / 'dask', where)
        assert len(outcome.failed_bags) == 1 and not outcome.failed_robots and not where.warning
        monkeypatch.setattr(fleet_run, '_CONNECT', 1.0)
        for other in (address, 'tcp' + address[3:]):
            with pytest.raises(DataError, match='no Dask scheduler answers') as error:
                fit(fleet, tmp_path / 'plain', ClusterOptions(scheduler=other))
            assert '\n' not in str(error.value)
        assert 'can run code' in ClusterOptions(scheduler=other).warning
    finally:
        for process in processes:
            process.kill()
            process.wait()
            process.stderr.close()
    fit(fleet, tmp_path / 'one')
    assert weights(tmp_path / 'dask') == weights(tmp_path / 'one')


def test_ctrl_c_ends_all_processes_with_one_line(fleet, tmp_path):
    robots = tmp_path / 'robots'
    for number in range(16):
        shutil.copytree(fleet / 'anna', robots / f'r{number}')
    # A shell starts programs in the background with this signal ignored.
    process = subprocess.Popen(
        ['env', '--default-signal=INT', sys.executable, '-m', 'gravity_comp_ros.cli', 'fleet',
         'fit', str(robots), '-o', str(tmp_path / 'out'), '--workers', '2', '--formulation',
         'potential'],
        stderr=subprocess.PIPE, text=True, start_new_session=True)
    with process:
        lines = []
        for line in process.stderr:
            lines.append(line)
            if line.startswith('... fit'):
                os.killpg(process.pid, signal.SIGINT)   # as a terminal does
                break
        lines += process.stderr.readlines()   # until every process has closed it
    assert process.returncode == 130 and lines[-1] == 'gravity_comp fleet: interrupted\n'
    assert not any('Traceback' in line for line in lines)


def test_the_command_fits_and_diagnoses(fleet, tmp_path, capsys):
    models = tmp_path / 'models'
    assert cli.main(['fleet', 'fit', str(fleet), '-o', str(models), '--workers', '1',
                     '--formulation', 'potential', '--json']) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed['robots']) == {'anna', 'bert'} and len(printed['failed_bags']) == 1
    assert cli.main(['fleet', 'diagnose', str(fleet / 'anna'), '-o', str(tmp_path / 'found'),
                     '--models', str(models), '--workers', '1']) == 0
    assert 'anna.diagnosis.json' in capsys.readouterr().out
    for what, *other in (('diagnose', '--max-speed', '0.3'), ('diagnose', '--all-samples'),
                         ('diagnose', '--rate', '2'), ('fit', '--effects', 'joint_spring'),
                         ('fit', '--models', str(models))):
        assert cli.main(['fleet', what, str(fleet / 'anna'), '-o', str(tmp_path / 'found'),
                         *other]) == 2
        assert other[0] in capsys.readouterr().err
    results = json.loads((tmp_path / 'found' / 'anna.diagnosis.json').read_text())
    assert {'findings', 'joints'} <= set(results)
    assert cli.main(['fleet', 'diagnose', str(fleet / 'anna'), '-o', str(tmp_path / 'found'),
                     '--models', str(models), '--workers', '1', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['resumed'] == 1
    before = (models / 'anna.json').read_bytes()
    assert cli.main(['fleet', 'diagnose', str(fleet / 'anna'), '-o', str(models),
                     '--models', str(models), '--workers', '1']) == 0
    assert (models / 'anna.json').read_bytes() == before
    assert (models / 'anna.diagnosis.json').exists()
