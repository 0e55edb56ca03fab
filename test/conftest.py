"""Fixtures, terminal width and order of all tests."""

import fcntl
import gc
import os
from pathlib import Path
import re

from hypothesis import settings
import pytest

# Examples of each property; a time limit of one example would fail on a busy machine.
settings.register_profile('quick', max_examples=25, deadline=None)
settings.load_profile('quick')
# Test files of more than ten seconds, the longest first.
LONGEST = (
    'test_ten_minutes.py', 'test_workbench_loop.py', 'test_workbench_input.py',
    'test_joint_gains.py', 'test_node_suspicion.py', 'test_node_learning.py',
    'test_description_check.py', 'test_report_html.py', 'test_node_acceptance.py',
    'test_pages.py', 'test_node_ros.py', 'test_diagnosis.py', 'test_fleet.py',
    'test_workbench_session.py', 'test_chain_fit.py', 'test_node_fitting.py', 'test_updates.py',
    'test_gravity_fit.py', 'test_same_model.py', 'test_pushed_arm.py',
    'test_tilt_and_zero_angles.py', 'test_refit.py', 'test_commands_fit_compare.py')
BAGS = Path(__file__).resolve().parents[1] / 'bags'
# Modules that package.xml does not name, so that a workspace with rosdep's packages lacks them.
OPTIONAL = {'bokeh', 'dask', 'distributed', 'mujoco', 'playwright', 'pyarrow', 'shtab', 'tornado'}


@pytest.fixture(scope='session')
def iiwa_model_file(tmp_path_factory) -> Path:
    """Return the file of the initial model of most node tests; read-only, for all workers."""
    from gravity_comp_ros.data.gate import slow_samples
    from gravity_comp_ros.estimation.fit import fit
    from gravity_comp_ros.models.model_file import save_model
    from gravity_comp_ros.recordings.bag import read_bag
    root = tmp_path_factory.getbasetemp()
    if 'PYTEST_XDIST_WORKER' in os.environ:
        root = root.parent
    path = root / 'unloaded.json'
    with (root / 'unloaded.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            samples = read_bag(BAGS / 'eq17_unloaded.mcap').samples
            save_model(path, fit(slow_samples(samples).samples).model)
    return path


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    """Remove the terminal width of the parent shell or pytest process."""
    monkeypatch.delenv('COLUMNS', raising=False)


def pytest_collection_modifyitems(items):
    """Run the longest files first, so that workers finish at about the same time."""
    place = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


def pytest_collection_finish():
    """Exclude imported objects from later garbage collections, of which tests run many."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Skip a file that imports an optional module which is not installed."""
    report = yield
    missing = re.search(r"No module named '(\w+)", str(report.longrepr)) if report.failed else None
    if missing and missing[1] in OPTIONAL:
        report.outcome = 'skipped'
        report.longrepr = str(collector.path), None, f'Skipped: {missing[1]} is not installed'
    return report


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Schedule by file, robust to the crash of a worker."""
    from file_scheduling import FileScheduling
    config.option.loadscopereorder = False
    return FileScheduling(config, log)
