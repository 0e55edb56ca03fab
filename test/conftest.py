"""What all tests share: nothing of the screen that they were started from."""

import pytest


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    """Take away the width that a shell or another process of pytest handed down."""
    monkeypatch.delenv('COLUMNS', raising=False)
