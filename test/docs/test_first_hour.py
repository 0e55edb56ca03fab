"""docs/first_hour.md and docs/tables.md show the output of their commands."""

from pathlib import Path
import re

from docs import make_first_hour
from gravity_comp_ros.models.model_file import load_model
import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs'
PAGE = (DOCS / 'first_hour.md').read_text()
TABLES = (DOCS / 'tables.md').read_text()
NUMBER = re.compile(r'[-+]?\d+(?:\.\d+)?')
# Tolerances of figures, which differ between machines. Slow motion does not determine lengths.
RELATIVE, ABSOLUTE = 0.05, 0.02
LENGTHS = re.compile(r'l_\w+ = .*? more')


@pytest.fixture(scope='module', autouse=True)
def narrow():
    """Remove the terminal width also for the fixtures of this module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('COLUMNS', '')
        yield


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Run every command; return the page that results, and the folder."""
    folder = tmp_path_factory.mktemp('hour')
    return make_first_hour.page(PAGE, folder), folder


def words(page):
    """Return the words of a page without layout, with # for numbers, and the numbers."""
    text = LENGTHS.sub('', ' '.join(re.sub('─+', '', page).split()))
    return NUMBER.sub('#', text).split(' '), [float(x) for x in NUMBER.findall(text)]


def assert_printed(page, printed):
    text, numbers = words(page)
    printed_text, printed_numbers = words(printed)
    assert text == printed_text, 'python3 docs/make_first_hour.py'
    assert numbers == pytest.approx(printed_numbers, rel=RELATIVE, abs=ABSOLUTE)


def test_the_page_shows_the_output_of_the_commands(run):
    assert_printed(PAGE, run[0])


def test_the_page_on_tables_shows_the_output_of_the_commands(tmp_path):
    pytest.importorskip('pyarrow')
    assert_printed(TABLES, make_first_hour.tables_page(TABLES, tmp_path))
    # The hidden friction is found: 0.3 N·m from per mille.
    assert re.search(r'shoulder_pan +coulomb_friction +established +F_c = 0.(30|299)', TABLES)


def test_the_hidden_friction_is_found_and_added():
    size, half = map(float, re.search(
        r'added coulomb_friction:iiwa_joint_4: F_c = ([\d.]+) ± ([\d.]+) N·m', PAGE).groups())
    assert abs(size - 0.8) < half < 0.05
    assert re.search(r'iiwa_joint_4 +coulomb_friction +established', PAGE)
    before, after = map(float, re.search(
        r'change\n ─+\n(?:.*\n)*? iiwa_joint_4 +([\d.]+) +([\d.]+) ', PAGE).groups())
    # The noise is 0.1 N·m. Each run is predicted by a model fitted to the other one alone.
    assert before == pytest.approx(0.8, rel=0.1) and after < 0.2


def test_the_model_file_records_addition_and_undo(run):
    model = load_model(run[1] / 'arm.json')
    assert not model.applied.effects
    assert [step.action for step in model.history] == ['added', 'removed']


def test_the_pages_have_no_local_paths_and_no_crash():
    for word in ('/work', '/tmp', 'Traceback', 'internal error'):
        assert word not in PAGE + TABLES
