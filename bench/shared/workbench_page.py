"""A served workbench, and steps on its page in a browser."""

from contextlib import contextmanager
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

from bench.shared.browser import ROOT

PATIENCE = 240.0  # s
RMSE = 'td:nth-of-type(1)'  # in the table of errors
# Heading of each view, and its number of plots for one joint.
VIEWS = {'Over time': ('Over time', 2),
         'Residual': ('Residual against speed, position, load and time', 5),
         'Effects': ('Missing effects', 1), 'Model': ('The model', 0),
         'Data': ('Quality of the data', 0), 'Provenance': ('Provenance', 0),
         'Summary': ('Error of each joint', 1)}


@contextmanager
def served(folder, *argv):
    """Yield the address of a workbench, and its process."""
    log = (folder / 'workbench.log').open('w+')
    process = subprocess.Popen(
        [sys.executable, '-m', 'gravity_comp_ros.cli', 'workbench', *argv, '--port', '0',
         '--no-browser'], cwd=folder, stdout=subprocess.PIPE, stderr=log, text=True,
        env={**os.environ, 'PYTHONPATH': str(ROOT), 'XDG_STATE_HOME': str(folder / 'state')})
    try:
        line = process.stdout.readline()
        address = re.search(r'http://127\.0\.0\.1:\d+/\?token=\S+', line)
        log.seek(0)
        assert address, line + log.read()
        yield address[0], process
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
        log.seek(0)
        assert 'Traceback' not in (logged := log.read()), logged
    finally:
        process.kill()
        process.wait(PATIENCE)
        process.stdout.close()
        log.close()


def home(address):
    """Return the prefix of the server's own addresses."""
    return address.split('?')[0]


def row(page, joint):
    """Return the row of a joint in a table of the view."""
    return view_of(page).get_by_role('row', name=re.compile(f'^{joint} ')).first


def view_of(page):
    """Return the frame of the view."""
    return page.frame_locator('#frame')


def rmse(page, joint):
    """Return the RMSE of a joint in the view of errors."""
    row(page, joint).wait_for()
    return row(page, joint).locator(RMSE).inner_text()


def look(tab, name):
    """Open a view and wait until its plots are drawn."""
    title, at_least = VIEWS[name]
    tab.page.get_by_role('button', name=name, exact=True).click()
    view_of(tab.page).get_by_role('heading', name=title, exact=True).wait_for()
    view_of(tab.page).locator('html[data-ready=yes]').wait_for()
    tab.wait_for_plots(at_least)


def saved(page, button, path):
    """Click a button that downloads a file; return the path where it is saved."""
    with page.expect_download() as download:
        page.get_by_role('button', name=button).click()
    download.value.save_as(path)
    return path


def workers(pid):
    """Return the worker processes of a server."""
    workers = []
    for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split():
        if 'worker.serve' in Path(f'/proc/{child}/cmdline').read_text():
            workers.append(int(child))
    return workers
