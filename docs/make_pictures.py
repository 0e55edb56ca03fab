"""
Make the pictures of docs/report.md and docs/workbench.md, in headless Chromium.

    python3 -m docs.make_pictures

A simulated arm with unmodelled friction is recorded, and shown in a report and the workbench.
"""

import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile

from bench.shared.browser import Watched, watched
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
URDF = ROOT / 'bags' / 'iiwa7.urdf'
PICTURES = ROOT / 'docs' / 'pictures'
MOTION = ['--motion', 'multisine', '--max-speed', '0.12', '--rate', '20', '--duration', '60',
          '--noise', '0.1', '--hidden', 'coulomb_friction:iiwa_joint_4=0.8']
_PROGRAM = [sys.executable, '-m', 'gravity_comp_ros.cli']
# Seconds that a step may take: on a busy machine each takes minutes.
_WAIT = 600
_TALLEST, _COLOURS = 1000, 255
_SCREEN, _NARROW, _DRAWN = {'width': 1280, 'height': 860}, {'width': 400, 'height': 860}, 2000


def _gravity_comp(folder: Path, *argv: str) -> None:
    subprocess.run([*_PROGRAM, *argv], cwd=folder, check=True, stdout=subprocess.DEVNULL,
                   timeout=_WAIT)


def _report(folder: Path) -> None:
    page = folder / 'report.html'
    _gravity_comp(folder, 'diagnose', 'run1.mcap', 'run2.mcap', '--model', 'arm.json', '--html',
                  page.name, '--urdf', str(URDF))
    with watched(page.as_uri(), color_scheme='dark') as tab:
        tab.page.set_viewport_size(_NARROW)
        _opened(tab, page.as_uri())
        tab.page.screenshot(path=PICTURES / 'report-narrow.png')
    with watched(page.as_uri()) as tab:
        # As tall as the largest part, since scrolled screenshots show the tools in the middle.
        tab.page.set_viewport_size({'width': 1280, 'height': 2000})
        _opened(tab, page.as_uri())
        for part in ('residuals', 'arm', 'effects'):
            tab.page.locator(f'#{part}').screenshot(path=PICTURES / f'report-{part}.png')
        tab.page.set_viewport_size(_SCREEN)
        tab.page.evaluate('scrollTo(0, 0)')
        tab.page.wait_for_timeout(_DRAWN)
        tab.page.screenshot(path=PICTURES / 'report-top.png')


def _opened(tab: Watched, address: str) -> None:
    tab.page.set_default_timeout(_WAIT * 1000)
    tab.open(address)
    tab.page.wait_for_timeout(_DRAWN)


def _look(tab: Watched, view: str, heading: str) -> None:
    """Open a view, and wait until it is there and its plots are drawn."""
    tab.page.get_by_role('button', name=view, exact=True).click()
    tab.page.frame_locator('#frame').get_by_role('heading', name=heading).wait_for()
    tab.wait_for_plots(1)
    tab.page.wait_for_timeout(_DRAWN)


def _workbench(folder: Path) -> None:
    process = subprocess.Popen([*_PROGRAM, 'workbench', 'run1.mcap', 'run2.mcap', '--port', '0',
                                '--no-browser', '--urdf', str(URDF)], cwd=folder,
                               stdout=subprocess.PIPE, text=True,
                               env={**os.environ, 'XDG_STATE_HOME': str(folder)})
    assert process.stdout is not None
    try:
        match = re.search(r'http://\S+', process.stdout.readline())
        assert match is not None
        home = match[0].split('?')[0]
        with watched(home, color_scheme='light') as tab:
            _worked(tab, match[0])
        # The same work, on another screen.
        with watched(home, color_scheme='dark') as tab:
            tab.page.set_viewport_size(_NARROW)
            _opened(tab, match[0])
            _look(tab, 'Summary', 'Error of each joint')
            tab.page.screenshot(path=PICTURES / 'workbench-narrow-dark.png')
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(_WAIT)


def _worked(tab: Watched, address: str) -> None:
    """Run the loop once."""
    page = tab.page
    _opened(tab, address)
    add = page.get_by_role('button', name='Add coulomb_friction:iiwa_joint_4')
    add.wait_for()
    _look(tab, 'Summary', 'Error of each joint')
    page.screenshot(path=PICTURES / 'workbench-found.png')
    add.click()
    page.locator('.fall').wait_for()
    page.locator('#idle').wait_for()
    _look(tab, 'Summary', 'Error of each joint')
    page.screenshot(path=PICTURES / 'workbench-added.png')
    page.get_by_role('button', name='Dark or light', exact=True).click()
    page.wait_for_selector('html.dark')
    _look(tab, 'Over time', 'Over time')
    page.screenshot(path=PICTURES / 'workbench-dark.png')


def _smaller(path: Path) -> None:
    """Keep the top of a picture, reduced to its most frequent colours."""
    with Image.open(path) as picture:
        top = picture.convert('RGB').crop((0, 0, picture.width, min(picture.height, _TALLEST)))
    top.quantize(_COLOURS, Image.Quantize.MEDIANCUT, kmeans=3, dither=Image.Dither.NONE).save(
        path, optimize=True)


def main() -> None:
    """Record, report, work, and keep the pictures."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed in ('1', '2'):
            _gravity_comp(folder, 'synth', *MOTION, '--seed', seed, '-o', f'run{seed}.mcap')
        _gravity_comp(folder, 'fit', 'run1.mcap', 'run2.mcap', '-o', 'arm.json')
        _report(folder)
        _workbench(folder)
    for path in PICTURES.glob('*.png'):
        _smaller(path)


if __name__ == '__main__':
    main()
