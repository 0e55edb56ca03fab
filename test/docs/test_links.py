"""Links, files and commands that the pages name exist."""

from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
FOLDERS = 'bags|bench|config|examples|requirements|test|tools'


def anchors(page):
    """Return the anchors of the headings of a page."""
    headings = re.findall(r'^#+ (.*)$', page.read_text(), re.MULTILINE)
    return {re.sub(r'[^\w -]', '', heading.lower()).replace(' ', '-') for heading in headings}


def each(pages):
    return pytest.mark.parametrize('page', pages, ids=lambda page: page.name)


@each(PAGES)
def test_links_resolve(page):
    for link in re.findall(r'\]\(([^):]+)\)', page.read_text()):
        name, _, anchor = link.partition('#')
        target = page.parent / name if name else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@each(PAGES)
def test_files_and_benches_exist(page):
    text = page.read_text()
    paths = re.findall(rf'(?<![\w/])((?:{FOLDERS})/[\w./-]*\w)', text)
    paths += [module.replace('.', '/') for module in re.findall(r'-m (bench[\w.]*\w)', text)]
    assert [path for path in paths if not any(
        (ROOT / (path + ending)).exists() for ending in ('', '.py'))] == []
