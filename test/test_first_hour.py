"""docs/first_hour.md: every command on the page was printed by a command before it."""

import importlib.util
from pathlib import Path
import re
import sys

import pytest

DOCS = Path(__file__).resolve().parent.parent / 'docs'
PAGE = (DOCS / 'first_hour.md').read_text()


@pytest.fixture(scope='module')
def script():
    """Return the module that makes the page."""
    pytest.importorskip('rosbags')
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS))
        spec = importlib.util.spec_from_file_location('hour', DOCS / 'make_first_hour.py')
        module = importlib.util.module_from_spec(spec)
        patch.setitem(sys.modules, 'hour', module)   # required by dataclasses
        spec.loader.exec_module(module)
        yield module


def commands(part):
    """Return the commands of a part, each with the text above it."""
    return [(match[1], part[:match.start()])
            for match in re.finditer(r'^\$ (gravity_comp .*)$', part, re.MULTILINE)]


def test_every_command_was_printed_before(script):
    parts = script._by_part(PAGE[PAGE.index('\n## ') + 1:])
    assert {script.WALK, script.OWN_TABLE, script.OWN_BAG,
            *(title for title, _, _ in script.REAL)} <= set(parts)
    for title in set(parts) - {script.WALK, script.SET_UP, script.TESTS}:
        first, *rest = commands(parts[title])
        assert len(rest) >= 3, title
        for command, above in rest:
            # `convert` is repeated with the options that its error requires.
            assert f'\n  {command}\n' in above or ' convert ' in command, (title, command)


def test_the_page_has_no_local_paths_and_no_crash():
    for word in ('/work', '/tmp', 'Traceback', 'internal error'):
        assert word not in PAGE


def test_only_the_first_next_step_is_followed(script):
    printed = ('a table\nnext step: fit it, then\n    add\n  gravity_comp fit a.mcap -o b.json\n'
               '  gravity_comp add x a.mcap\n\nopen: one\nnext step: plan\n  gravity_comp plan\n')
    assert script.next_commands(printed) == [
        'gravity_comp fit a.mcap -o b.json', 'gravity_comp add x a.mcap']
    assert script.next_commands('next step: nothing\nwarning: x\n') == []


def test_parts_that_are_not_remade_stay(script, tmp_path):
    session = script.Session(tmp_path, ())
    session.begin(script.WALK, 'new')
    session.times = [(script.WALK, 3.4)]
    session.keep_other_parts(PAGE)
    page = session.page()
    assert '| The walk-through | 3 s |' in page and '\nnew\n' in page
    old, new = (script._by_part(text[text.index('\n## ') + 1:]) for text in (PAGE, page))
    assert list(new) == list(old)
    assert all(new[title] == old[title] for title in old if title != script.WALK)
