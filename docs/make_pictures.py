"""
Make the pictures of docs/report.md and docs/workbench.md, in headless Chromium.

    python3 docs/make_pictures.py

A simulated arm with friction that no model knows of is recorded, reported and put on the bench.
"""

from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))

from browser import watched  # noqa: E402
from PIL import Image  # noqa: E402

URDF = ROOT / 'bags' / 'iiwa7.urdf'
PICTURES = ROOT / 'docs' / 'pictures'
MOTION = ['--motion', 'multisine', '--max-speed', '0.12', '--rate', '20', '--duration', '60',
          '--noise', '0.1', '--hidden', 'coulomb_friction:iiwa_joint_4=0.8']
_PROGRAM = [sys.executable, '-m', 'gravity_comp_ros.cli']
_WAIT = 300
_TALLEST, _COLOURS = 960, 200
_NARROW, _DRAWN = {'width': 400, 'height': 860}, 2000


def _gravity_comp(folder: Path, *argv: str) -> None:
    subprocess.run([*_PROGRAM, *argv], cwd=folder, check=True, stdout=subprocess.DEVNULL,
                   timeout=_WAIT)


def _report(folder: Path) -> None:
    page = folder / 'report.html'
    _gravity_comp(folder, 'diagnose', 'run1.mcap', 'run2.mcap', '--model', 'arm.json', '--html',
                  page.name, '--urdf', str(URDF))
    with watched(page.as_uri(), color_scheme='dark') as tab:
        tab.page.set_viewport_size(_NARROW)
        tab.open(page.as_uri())
        tab.page.wait_for_timeout(_DRAWN)
        tab.page.screenshot(path=PICTURES / 'report-narrow.png')
    with watched(page.as_uri()) as tab:
        tab.open(page.as_uri())
        tab.page.screenshot(path=PICTURES / 'report-top.png')
        for part in ('residuals', 'arm', 'pairs', 'effects'):
            place = tab.page.locator(f'#{part}')
            place.screenshot(path=PICTURES / f'report-{part}.png')


def _workbench(folder: Path) -> None:
    process = subprocess.Popen([*_PROGRAM, 'workbench', 'run1.mcap', 'run2.mcap', '--port', '0',
                                '--no-browser', '--forget', '--urdf', str(URDF)], cwd=folder,
                               stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        found = re.search(r'http://\S+/', process.stdout.readline())
        assert found is not None
        with watched(found[0]) as tab:
            tab.open(found[0])
            add = tab.page.get_by_role('button', name='Add coulomb_friction:iiwa_joint_4')
            add.wait_for(timeout=_WAIT * 1000)
            tab.page.screenshot(path=PICTURES / 'workbench-found.png')
            add.click()
            tab.page.locator('.fall').wait_for(timeout=_WAIT * 1000)
            tab.page.locator('#idle').wait_for(timeout=_WAIT * 1000)
            tab.page.wait_for_timeout(_DRAWN)
            tab.page.screenshot(path=PICTURES / 'workbench-added.png')
            tab.page.get_by_role('button', name='Dark').click()
            tab.page.get_by_role('button', name='Two models').click()
            tab.page.get_by_role('heading', name='against 1. gravity').wait_for()
            tab.page.wait_for_timeout(_DRAWN)
            tab.page.screenshot(path=PICTURES / 'workbench-dark.png')
            tab.page.set_viewport_size(_NARROW)
            tab.page.get_by_role('button', name='Arm').click()
            tab.page.wait_for_timeout(_DRAWN)
            tab.page.locator('#views').screenshot(path=PICTURES / 'workbench-arm-narrow.png')
            tab.page.get_by_role('button', name='Light').click()
            tab.page.get_by_role('button', name='Answer').click()
            tab.page.wait_for_timeout(_DRAWN)
            tab.page.locator('#views').screenshot(path=PICTURES / 'workbench-narrow.png')
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(_WAIT)


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
        with Image.open(path) as picture:
            top = picture.convert('RGB').crop((0, 0, picture.width, min(picture.height, _TALLEST)))
        # Few colours, chosen so that rare ones keep theirs.
        top.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


if __name__ == '__main__':
    main()
