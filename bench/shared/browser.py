"""Headless Chromium for tests of pages, with a record of warnings, requests and dialogs."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
import os
from pathlib import Path
import shutil

import pytest

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / 'test-artifacts'
NAMES = ('chromium', 'chromium-browser', 'google-chrome')
OPTIONS = ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
           '--disable-background-networking', '--disable-component-update', '--disable-sync']
# Longest wait of an assertion in ms: a busy machine takes minutes for what takes seconds alone.
WAIT = 240_000
# Names with markup, and with formulas that MathJax would turn into links that run a script.
LINK = r'\href{javascript:alert(3)}{\text{x}}'
EVIL = (f'<img src=x onerror=alert(1)> $${LINK}$$ $$${LINK}$$$',
        rf'</script><script>alert(2)</script> \[{LINK}\] \({LINK}\)')
EVIL_BAG = f'<b onclick=alert(4)> $${LINK}$$.mcap'

# For every painted plot of a page: title, width and height in pixels.
PLOTS = """() => {
  const results = []
  const walk = (view) => {
    if (view.model.type == 'Figure' && view._render_count && view.el.offsetParent !== null)
      results.push([view.model.title ? view.model.title.text : '', view.frame.bbox.width,
                    view.frame.bbox.height])
    for (const child of view.child_views || []) walk(child)
  }
  for (const view of window.Bokeh ? Bokeh.index.roots : []) walk(view)
  return results
}"""
# The number of selected rows of the shared table of all plots.
SELECTED = """() => {
  for (const document of Bokeh.documents)
    for (const model of document._all_models.values())
      if (model.type == 'ColumnDataSource' && model.get_column('q0') != null)
        return model.selected.indices.length
}"""

# Active elements of a page, including shadow roots, that text from files must not create.
LIVELY = """() => {
  const results = []
  const walk = (root) => {
    for (const element of root.querySelectorAll('*')) {
      const name = element.localName, link = element.getAttribute('href') || ''
      const handles = element.getAttributeNames().some(n => n.startsWith('on'))
      if (handles || name.startsWith('mjx') || link.startsWith('javascript:')
          || (name == 'img' && element.getAttribute('src') == 'x')) results.push(element.outerHTML)
      if (element.shadowRoot) walk(element.shadowRoot)
    }
  }
  walk(document)
  return results
}"""
# Inject a handler, a script, and a link that runs a script.
INJECT = """() => {
  const place = document.createElement('div')
  place.innerHTML = '<img src="data:," onerror="alert(1)"><a href="javascript:alert(2)">x</a>'
  document.body.append(place)
  const script = document.createElement('script')
  script.textContent = 'alert(3)'
  document.body.append(script)
  place.querySelector('a').click()
}"""


def heap(page) -> float:
    """Return the JavaScript heap of a page in MB, after garbage collection."""
    session = page.context.new_cdp_session(page)
    for _ in range(3):
        session.send('HeapProfiler.collectGarbage')
    used = session.send('Runtime.getHeapUsage')['usedSize']
    session.detach()
    return used / 1e6


def chromium() -> str:
    """Return the browser's path; skip without one, or fail where it is required."""
    browser = next((path for path in map(shutil.which, NAMES) if path), None)
    if browser is None:
        why = 'no Chromium on this machine (tools/get_browser.sh installs one)'
        if os.environ.get('GRAVITY_COMP_BROWSER') == 'required':
            pytest.fail(why)
        pytest.skip(why)
    return browser


class Watched:
    """A page with its console warnings, external requests and dialogs."""

    def __init__(self, page, home: str) -> None:
        self.page, self.complaints, self.requests, self.dialogs = page, [], [], []
        page.set_default_timeout(WAIT)
        page.on('console', self._printed)
        page.on('pageerror', lambda error: self.complaints.append(str(error)))
        page.on('dialog', self._asked)
        page.on('request', lambda request: self.requests.append(request.url)
                if not request.url.startswith((home, 'data:', 'blob:')) else None)

    def open(self, url: str) -> None:
        """Open a page and wait until its plots are drawn."""
        self.page.goto(url)
        self.page.wait_for_selector('html[data-ready=yes]')

    def picture(self, name: str) -> None:
        """Save a screenshot as an artefact of the test run."""
        PICTURES.mkdir(exist_ok=True)
        self.page.screenshot(path=PICTURES / f'{name}.png', full_page=True)

    def drag(self, plot, start: float, end: float) -> None:
        """Drag over a plot in the middle of the screen, between two fractions of its width."""
        plot.evaluate("element => element.scrollIntoView({block: 'center'})")
        box = plot.bounding_box()
        self.page.mouse.move(box['x'] + start * box['width'], box['y'] + 0.2 * box['height'])
        self.page.mouse.down()
        self.page.mouse.move(box['x'] + end * box['width'], box['y'] + 0.95 * box['height'],
                             steps=4)
        self.page.mouse.up()

    def select(self, plot, start: float, end: float) -> None:
        """Drag over a plot until rows are selected: a page that is still laid out loses a drag."""
        from playwright.sync_api import TimeoutError as Late
        for _ in range(10):
            self.drag(plot, start, end)
            with suppress(Late):
                self.views.wait_for_function(f'({SELECTED})() > 0', timeout=10_000)
                return
        raise AssertionError('nothing is selected')

    @property
    def views(self):
        """Return the frame of the plots: that of the workbench, or the page of a report."""
        return self.page.frame(name='view') or self.page.main_frame

    def plots(self) -> list:
        """Return title, width and height of every plot that is on the page."""
        return self.views.evaluate(PLOTS)

    def wait_for_plots(self, number: int) -> None:
        """Wait until at least `number` plots are drawn, none of them too narrow to read."""
        self.views.wait_for_function(
            f'(n) => {{ const p = ({PLOTS})(); return p.length >= n && p.every(x => x[1] > 60) }}',
            arg=number)

    def selected(self) -> int:
        """Return the number of selected rows of the shared table."""
        return self.views.evaluate(SELECTED)

    def _printed(self, message) -> None:
        if message.type in ('error', 'warning'):
            self.complaints.append(message.text)

    def _asked(self, dialog) -> None:
        self.dialogs.append(dialog.message)
        dialog.dismiss()


def expect(target):
    """
    Return assertions of a page or locator that are repeated until they hold.

    A page of the workbench is updated in several messages, so that what is read from it at once
    may be of two states.
    """
    from playwright.sync_api import expect
    return expect(target)


@contextmanager
def watched(home: str, **options) -> Iterator[Watched]:
    """Yield a new page; `home` is the URL prefix of its own requests."""
    with browsing() as browser:
        with browser(home, **options) as tab:
            yield tab


@contextmanager
def browsing() -> Iterator[Callable[..., AbstractContextManager[Watched]]]:
    """Yield a function that opens watched pages of one browser."""
    path = chromium()
    from playwright.sync_api import expect as assertions, sync_playwright
    assertions.set_options(timeout=WAIT)
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=path, args=OPTIONS)

        @contextmanager
        def page(home: str, **options) -> Iterator[Watched]:
            context = browser.new_context(viewport={'width': 1280, 'height': 860}, **options)
            try:
                yield Watched(context.new_page(), home)
            finally:
                context.close()

        try:
            yield page
        finally:
            browser.close()
