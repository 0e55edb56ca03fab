"""
Loading time and memory of report and workbench, for an hour of seven joints at 100 Hz.

    python3 -m bench.pages [FOLDER]

Prints seconds of wall time in headless Chromium: of a report, to its first paint and to its last
plot; of the workbench, from the command to the views and to the model, from a click on Add to
the new error; and the JavaScript heap before and after 100 actions, at the same view. The output
includes processor time, of the page's main thread or of the workbench with its worker process,
because wall time is unreliable on a busy machine. The browser is already open, so that its start
is excluded.
"""

from contextlib import contextmanager
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile
import time

from bench.shared.browser import browsing, heap

_PROGRAM = [sys.executable, '-m', 'gravity_comp_ros.cli']
_HOUR = ['--motion', 'multisine', '--max-speed', '0.12', '--rate', '100', '--duration', '3600',
         '--noise', '0.1', '--hidden', 'coulomb_friction:iiwa_joint_4=0.8', '--seed', '1']
_PAINT = "performance.getEntriesByType('paint')[0].startTime / 1000"
_VIEWS = {'Errors': 'Errors by joint', 'Over time': 'Over time',
          'Residual': 'Residual against speed, position, load and time',
          'Data': 'Quality of the data', 'Summary': 'Error of each joint'}
_TICKS = os.sysconf('SC_CLK_TCK')
# Longest wait for an element of a page, in ms.
_TIMEOUT = 300_000
# Duration of a browser's own work after its start, in ms.
_STARTUP = 3000


def _command(folder: Path, *arguments: str) -> float:
    started = time.monotonic()
    subprocess.run([*_PROGRAM, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)
    return time.monotonic() - started


def _print(quantity: str, value: float, unit: str = 's') -> None:
    print(f'{quantity:<58}{value:8.2f} {unit}', flush=True)


@contextmanager
def opened():
    """Yield a function that opens pages in a browser that has finished its start."""
    with browsing() as browser:
        with browser('about:') as tab:
            tab.page.goto('about:blank')
            tab.page.wait_for_timeout(_STARTUP)
            yield browser


def report(folder: Path) -> None:
    """Time the report of an hour."""
    _print('compare --html', _command(folder, 'compare', 'hour.mcap', '--model', 'hour.json',
                                      '--html', 'hour.html'))
    address = (folder / 'hour.html').as_uri()
    with opened() as browser, browser(address) as tab:
        thread = tab.page.context.new_cdp_session(tab.page)
        thread.send('Performance.enable', {'timeDomain': 'threadTicks'})
        started = time.monotonic()
        tab.open(address)
        _print('report: all plots', time.monotonic() - started)
        for metric in thread.send('Performance.getMetrics')['metrics']:
            if metric['name'] == 'TaskDuration':
                _print('report: processor time of the page', metric['value'])
        _print('report: first paint', tab.page.evaluate(_PAINT))
        _print('report: plots', len(tab.plots()), '')


@contextmanager
def served(folder: Path):
    """Yield the address of a workbench with the hour's recording, and its process id."""
    process = subprocess.Popen([*_PROGRAM, 'workbench', 'hour.mcap', '--port', '0', '--no-browser',
                                '--forget'], cwd=folder, stdout=subprocess.PIPE, text=True)
    try:
        yield re.search(r'http://\S+', process.stdout.readline())[0], process.pid
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def workbench(folder: Path) -> None:
    """Time the workbench on an hour, then measure its heap."""
    with opened() as browser:
        started = time.monotonic()
        with served(folder) as (address, pid), browser(address.split('?')[0]) as tab:
            _steps(tab, address, pid, started)


def _steps(tab, address: str, pid: int, started: float) -> None:
    """Time the actions of a user in the workbench."""
    page = tab.page
    page.set_default_timeout(_TIMEOUT)
    tab.open(address)
    page.get_by_role('button', name='Save the model').wait_for()
    _print('workbench: recording shown', time.monotonic() - started)
    page.locator('#verdict').wait_for()
    _print('workbench: model shown', time.monotonic() - started)
    add = page.get_by_role('button', name=re.compile('^Add coulomb_friction:iiwa_joint_4'))
    add.wait_for()
    _print('workbench: missing effect named', time.monotonic() - started)
    page.locator('#idle').wait_for()
    started, processor_start = time.monotonic(), _processor(pid)
    add.click()
    page.locator('.fall').wait_for()
    _print('workbench: Add, to the new error', time.monotonic() - started)
    _print('workbench: processor time of Add', _processor(pid) - processor_start)
    page.locator('#idle').wait_for()
    for view in _VIEWS:
        _open(page, view)
    before = heap(page)
    for number in range(100):
        _open(page, list(_VIEWS)[number % len(_VIEWS)])
    _print('workbench: heap before 100 actions', before, 'MB')
    _print('workbench: heap after them', heap(page), 'MB')


def _open(page, view: str) -> None:
    """Open a view and wait for it."""
    page.get_by_role('button', name=view, exact=True).click()
    page.locator('#views').get_by_role('heading', name=_VIEWS[view], exact=True).wait_for()
    page.wait_for_timeout(200)


def _processor(pid: int) -> float:
    """Return the processor time in s of a process and its descendants."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    return (int(fields[11]) + int(fields[12])) / _TICKS + sum(
        _processor(int(child)) for child in children)


def main() -> None:
    """Simulate an hour once, then time both pages."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else name)
        if not (folder / 'hour.mcap').exists():
            _command(folder, 'synth', *_HOUR, '-o', 'hour.mcap')
        if not (folder / 'hour.json').exists():
            _command(folder, 'fit', 'hour.mcap', '-o', 'hour.json')
        report(folder)
        workbench(folder)


if __name__ == '__main__':
    main()
