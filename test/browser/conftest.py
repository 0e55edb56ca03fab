"""The browser of all page tests, and a workbench with its recordings."""

from bench.shared.browser import browsing, EVIL, EVIL_BAG, LINK
from bench.shared.rough_links import two_links
from bench.shared.workbench_page import served
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import pytest


@pytest.fixture(scope='module')
def watched():
    """Yield the function that opens an address in the browser and watches its page."""
    with browsing() as page:
        yield page


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('workbench')
    for number in (1, 2):
        write_bag(folder / f'run{number}.mcap', [joint_states(two_links(number, 600))])
    write_bag(folder / 'other.mcap', [joint_states(two_links(1, names=('a', 'b')))])
    write_bag(folder / EVIL_BAG, [joint_states(two_links(1, 600, names=EVIL),
                                               f'/$${LINK}$$<img src=x>')])
    return folder


@pytest.fixture(scope='module')
def server(folder):
    """Return address and process of a workbench for two recordings."""
    with served(folder, 'run1.mcap', 'run2.mcap') as address_and_process:
        yield address_and_process
