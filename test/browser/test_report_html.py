"""`--html` of `compare` and `diagnose`: a self-contained page, or a page with the error."""

from dataclasses import replace
import json
import re
import subprocess
import sys

from bench.shared.browser import EVIL, EVIL_BAG, expect, INJECT, LINK, LIVELY
from bench.shared.rough_links import two_link_urdf, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, JointReport
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.evaluation.compare import compare
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.page import report_html
from gravity_comp_ros.report.views.summary import headline
import numpy as np
import pytest

ORDER = ['summary', 'time', 'arm', 'residuals', 'effects', 'model', 'quality', 'provenance']


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('report')
    for number in (1, 2, 3):
        write_bag(folder / f'run{number}.mcap', [joint_states(two_links(number))])
    write_bag(folder / 'other.mcap', [joint_states(two_links(1, names=('a', 'b')))])
    (folder / 'two.urdf').write_text(two_link_urdf())
    assert main(['fit', str(folder / 'run1.mcap'), str(folder / 'run2.mcap'), '-o',
                 str(folder / 'arm.json')]) == 0
    return folder


@pytest.fixture(scope='module')
def diagnosed(folder):
    page = folder / 'diagnosed.html'
    assert main(['diagnose', str(folder / 'run1.mcap'), str(folder / 'run2.mcap'), '--model',
                 str(folder / 'arm.json'), '--urdf', str(folder / 'two.urdf'), '--html',
                 str(page)]) == 0
    return page


@pytest.fixture(scope='module')
def contents():
    """Return contents with more samples than are drawn, of an arm with a description."""
    samples = two_links(count=24_000)
    slow = samples.select(np.arange(0, 24_000, 40))
    model = fit(slow, FitOptions('potential')).model
    return Contents(samples, model, compare(model, slow), '',
                    (), '', arm=described_arm(two_link_urdf(), samples.names).geometry)


def test_a_report_is_one_file_with_all_sections_in_order(diagnosed):
    html = diagnosed.read_text()
    assert re.findall(r'<section id="(\w+)">', html) == ORDER
    verdict = re.search(r'<h1[^>]*id="verdict">(.*?)</h1>', html)[1]
    assert 'Missing: Coulomb friction on joint shoulder' in verdict
    assert not re.search(r'<(script|link|img|iframe)[^>]*(src|href)=["\']?(https?:)?//', html)
    assert len(html) < 15e6
    for fact in ('coulomb_friction', 'run1.mcap', 'SHA-256', 'gravity_comp diagnose'):
        assert fact in html
    # It includes hash, version and command.
    assert re.search(r'[0-9a-f]{64}', html) and '0.1.0' in html


def test_sentence_table_and_plots_show_the_errors_of_compare(folder, capsys):
    model, page, errors = (folder / name for name in ('added.json', 'c.html', 'c.json'))
    model.write_bytes((folder / 'arm.json').read_bytes())
    assert main(['add', 'coulomb_friction:shoulder', '--model', str(model),
                 str(folder / 'run1.mcap'), str(folder / 'run2.mcap')]) == 0
    assert main(['compare', str(folder / 'run3.mcap'), '--model', str(model), '--html',
                 str(page), '--json', str(errors)]) == 0
    capsys.readouterr()
    html = page.read_text()
    rmse = {name: f'{joint["rmse"]:.4f}'
            for name, joint in json.loads(errors.read_text())['joints'].items()}
    worst = max(rmse, key=rmse.get)
    verdict = re.search(r'<h1[^>]*id="verdict">(.*?)</h1>', html)[1]
    assert f'largest on {worst}: {rmse[worst]} N·m' in verdict
    # The table also has the errors of the previous model and of a constant torque.
    assert 'before coulomb_friction:shoulder N·m' in html and 'constant N·m' in html
    for name, value in rmse.items():
        row = re.search(f'<th scope="row"[^>]*>{name}</th>(.*?)</tr>', html)[1]
        cells = re.findall(r'<td [^>]*class="number">([\d.]+)</td>', row)
        assert cells[0] == value
        if name == 'shoulder':
            assert float(value) < 0.5 * float(cells[-2]) < 0.5 * float(cells[-1])
        # Residual over time and against speed of each joint.
        assert html.count(f'{name}, RMSE {value} ') >= 2


@pytest.mark.parametrize('bag, urdf, cause', [
    ('other.mcap', 'two.urdf', 'shoulder'), ('none.mcap', 'two.urdf', 'none.mcap'),
    ('run1.mcap', 'none.urdf', 'none.urdf: no such file')])
def test_a_failure_is_reported_in_the_page(folder, capsys, bag, urdf, cause):
    page = folder / 'failed.html'
    assert main(['compare', str(folder / bag), '--model', str(folder / 'arm.json'), '--html',
                 str(page), '--urdf', str(folder / urdf)]) == 1
    message = capsys.readouterr().err.split(': ', 1)[1].strip()
    html = page.read_text()
    assert cause in html and '<h1' in html and 'Traceback' not in html
    assert message.split('<')[0].split('"')[0].split("'")[0][:40] in html


def test_without_bokeh_one_line_names_the_package_to_install(folder):
    program = ('import sys; sys.modules["bokeh"] = None\n'
               'from gravity_comp_ros.cli import main\nsys.exit(main(sys.argv[1:]))')
    for argv in (['compare', str(folder / 'run1.mcap'), '--model', str(folder / 'arm.json'),
                  '--html', str(folder / 'x.html')], ['workbench', str(folder / 'run1.mcap')]):
        done = subprocess.run([sys.executable, '-c', program, *argv], capture_output=True,
                              text=True, timeout=120)
        assert done.returncode == 1
        assert done.stderr.count('\n') == 1 and 'pip install bokeh' in done.stderr


def test_the_report_in_a_browser(diagnosed, watched):
    with watched(diagnosed.as_uri()) as tab:
        page = tab.page
        tab.open(diagnosed.as_uri())
        # Two plots over time, four residuals and a spectrum of one joint, and more.
        one = len(tab.plots())
        assert 7 + 3 <= one <= 7 + 10
        assert all(width > 60 and height > 25 for _, width, height in tab.plots())
        assert tab.selected() == 0
        first, last = page.locator('#time .bk-Figure').first, page.locator('#time .bk-Figure').last
        last.scroll_into_view_if_needed()
        box = last.bounding_box()
        page.mouse.move(box['x'] + 0.5 * box['width'], box['y'] + 0.5 * box['height'])
        page.locator('.bk-Tooltip').filter(
            has_text=re.compile(r'time.* s.*residual.* N·m', re.DOTALL)).first.wait_for()
        tab.select(first, 0.2, 0.4)
        text, rows = page.evaluate(_selection), tab.selected()
        assert 20 < rows < 1200 and re.search(
            rf'<b>{rows} drawn samples selected</b>: run1.mcap at [\d.]+ s to run1.mcap at', text)
        # The other joint, with the same selection, then both.
        joint = page.get_by_label('Plots of joint')
        expect(joint.locator('option:checked')).to_have_text('shoulder')
        joint.select_option(label='elbow')
        page.wait_for_function(f"() => ({_titles})('elbow, RMSE') == 2")
        assert tab.selected() == rows and len(tab.plots()) == one
        joint.select_option(label='all joints')
        tab.wait_for_plots(one + 7)
        assert len(tab.plots()) == one + 7
        tab.picture('report')
        assert tab.complaints == [] and tab.requests == [] and tab.dialogs == []


def test_the_arm_follows_the_slider_and_the_selection(contents, watched, tmp_path):
    page = tmp_path / 'large.html'
    page.write_text(report_html(contents))
    with watched(page.as_uri()) as tab:
        tab.open(page.as_uri())
        status = tab.page.get_by_role('status')
        expect(status).to_contain_text('At 0.00 s: shoulder')
        capsules = tab.page.evaluate(_capsules)
        # By keyboard only.
        tab.page.get_by_role('slider').first.focus()
        for _ in range(3):
            tab.page.keyboard.press('PageUp')
        status.filter(has_not_text='At 0.00 s').wait_for()
        assert tab.page.evaluate(_capsules) != capsules
        match = re.search(r'At ([\d.]+) s: shoulder (-?[\d.]+) rad, residual (-?[\d.]+) N·m',
                          status.inner_text())
        time, angle, error = map(float, match.groups())
        row = np.abs(contents.samples.t - time).argmin()
        assert angle == pytest.approx(contents.samples.q[row, 0], abs=6e-3)
        assert error == pytest.approx(contents.residual[row, 0], abs=1e-3)
        tab.drag(tab.page.locator('#arm .bk-Figure'), 0.4, 0.6)
        turned = tab.page.evaluate(_capsules)
        tab.drag(tab.page.locator('#time .bk-Figure').first, 0.7, 0.8)
        status.filter(has_not_text=f'At {time:.2f} s').wait_for()
        time = float(re.search(r'At ([\d.]+) s', status.inner_text())[1])
        assert 0.6 * contents.samples.t[-1] < time < 0.9 * contents.samples.t[-1]
        assert tab.page.evaluate(_capsules) != turned
        assert tab.complaints == [] and tab.requests == []


def test_a_narrow_dark_page_fits_and_prints_light(diagnosed, watched):
    with watched(diagnosed.as_uri(), color_scheme='dark') as tab:
        tab.page.set_viewport_size({'width': 400, 'height': 860})
        tab.open(diagnosed.as_uri())
        assert tab.page.evaluate('document.documentElement.scrollWidth') <= 400
        assert all(60 < width < 400 for _, width, _ in tab.plots())
        # Plots, swatches and tools are inverted; in print they are not.
        assert set(tab.page.evaluate(_filters)) == {'invert(0.92) hue-rotate(180deg)'}
        tab.page.emulate_media(media='print', color_scheme='dark')
        assert set(tab.page.evaluate(_filters)) == {'none'}
        assert tab.page.evaluate(
            'getComputedStyle(document.body).backgroundColor') == 'rgb(255, 255, 255)'
        assert tab.page.pdf().startswith(b'%PDF')
        assert tab.complaints == []


def test_names_with_markup_or_formulas_are_shown_as_text(folder, watched):
    write_bag(folder / EVIL_BAG, [joint_states(two_links(1, names=EVIL),
                                               f'/$${LINK}$$<img src=x>')])
    page = folder / 'evil.html'
    assert main(['diagnose', str(folder / EVIL_BAG), '--html', str(page)]) == 0
    assert 'fitted for this report to' in page.read_text()
    with watched(page.as_uri()) as tab:
        tab.open(page.as_uri())
        tab.page.get_by_label('Plots of joint').select_option(label='all joints')
        tab.wait_for_plots(18)
        assert tab.dialogs == [] and tab.complaints == [] and tab.requests == []
        assert tab.page.evaluate(LIVELY) == []
        assert tab.page.evaluate('typeof MathJax') == 'undefined'
        assert tab.page.locator('#summary th[scope=row]').first.inner_text() == EVIL[0]
        # The policy of the page also blocks injected scripts.
        tab.page.evaluate(INJECT)
        tab.page.wait_for_timeout(200)
        assert tab.dialogs == [] and len(tab.complaints) == 3, tab.complaints
        assert all('Content Security Policy' in line for line in tab.complaints)


def test_without_javascript_the_page_explains_the_missing_plots(diagnosed, watched):
    with watched(diagnosed.as_uri(), java_script_enabled=False) as tab:
        tab.page.goto(diagnosed.as_uri())
        assert tab.page.locator('noscript p').is_visible()
        assert 'Coulomb friction' in tab.page.locator('#verdict').inner_text()


def found_on(contents, verdict='established', effect='coulomb_friction'):
    """Return contents with one finding on a joint other than the worst."""
    joint = next(name for name in contents.joints if name != contents.worst)
    finding = Finding(joint, effect, verdict, (), {}, 0.1, 0.02, 0.0, 1.0, '', '')
    reports = {name: JointReport('', 0.1, 100.0, 0.2, 0.1, {}) for name in contents.joints}
    return replace(contents, diagnosis=Diagnosis((finding,), reports))


def test_headline_and_emphasised_row_agree(contents):
    # The training data had the same friction, so no error is larger.
    sentence = headline(contents)
    assert sentence.startswith('The error is largest on shoulder')
    assert 'no error exceeds twice the training error' in sentence
    findings = found_on(contents)
    row = re.search(r'<tr class="strong"[^>]*100%"><th [^>]*>(.*?)<', report_html(findings))
    assert row[1] == 'shoulder'
    error = contents.error('shoulder')
    for one in (contents, findings):
        assert f'shoulder: {error} N·m' in headline(one)
    assert headline(findings).endswith('Missing: Coulomb friction on joint elbow.')
    assert 'Not established (weak)' in headline(found_on(contents, 'weak'))
    # The name of an effect is escaped as well.
    assert '<img src=x' not in report_html(found_on(contents, effect=EVIL[0]))


_capsules = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'ColumnDataSource' && model.get_column('error'))
      return String([model.get_column('x'), model.get_column('y')])
}"""
_selection = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.name == 'selection') return model.text
}"""
# Number of shown plots whose title begins with a text.
_titles = """(start) => {
  let count = 0
  const walk = (view) => {
    if (view.model.type == 'Figure' && view.model.title?.text.startsWith(start)) count += 1
    for (const child of view.child_views || []) walk(child)
  }
  for (const view of Bokeh.index.roots) walk(view)
  return count
}"""
_filters = """() => {
  const filters = []
  const walk = (root) => {
    for (const element of root.querySelectorAll('*')) {
      if (element.matches('.bk-Figure, .key i')) filters.push(getComputedStyle(element).filter)
      if (element.shadowRoot) walk(element.shadowRoot)
    }
  }
  walk(document)
  return filters
}"""
