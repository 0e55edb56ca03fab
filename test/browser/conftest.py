"""The browser of all page tests."""

from bench.shared.browser import browsing
import pytest


@pytest.fixture(scope='module')
def watched():
    """Yield the function that opens an address in the browser and watches its page."""
    with browsing() as page:
        yield page
