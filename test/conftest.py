"""What all tests share: nothing of the screen that they were started from, and who runs what."""

import pytest


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    """Take away the width that a shell or another process of pytest handed down."""
    monkeypatch.delenv('COLUMNS', raising=False)


def pytest_collection_modifyitems(items):
    """Begin with the files that take longest, so that no worker is left alone with one."""
    slow = {item.path for item in items if item.get_closest_marker('slow')}
    items.sort(key=lambda item: item.path not in slow)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Schedule by file, in a way that outlives a worker that crashes."""
    from file_scheduling import FileScheduling
    config.option.loadscopereorder = False
    return FileScheduling(config, log)
