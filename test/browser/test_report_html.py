"""`--html` of `compare` and `diagnose`: a self-contained page, or a page with the error."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
import re
import subprocess
import sys

from bench.shared.browser import browsing, expect, INJECT, LIVELY
from bench.shared.rough_links import two_link_urdf, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, JointReport
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.evaluation.compare import compare
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.report.arm import described_arm
from gravity_comp_ros.report.contents import Contents, Origin
from gravity_comp_ros.report.headline import headline, named_joint
from gravity_comp_ros.report.page import report_html
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.views import joints
import numpy as np
import pytest

pytestmark = pytest.mark.slow

# Markup, and formulas that MathJax would turn into links that run a script.
LINK = r'\href{javascript:alert(3)}{\text{x}}'
EVIL = (f'<img src=x onerror=alert(1)> $${LINK}$$ $$${LINK}$$$',
        rf'</script><script>alert(2)</script> \[{LINK}\] \({LINK}\)')
EVIL_BAG = f'<b onclick=alert(4)> $${LINK}$$.mcap'
ORDER = ['summary', 'joints', 'time', 'residuals', 'pairs', 'spectrum', 'effects', 'model',
         'quality', 'provenance']


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('report')
    for number in (1, 2, 3):
        write_bag(folder / f'run{number}.mcap', [joint_states(two_links(number))])
    write_bag(folder / 'other.mcap', [joint_states(two_links(1, names=('a', 'b')))])
    write_bag(folder / EVIL_BAG, [joint_states(two_links(1, names=EVIL),
                                               f'/$${LINK}$$<img src=x>')])
    assert main(['fit', str(folder / 'run1.mcap'), str(folder / 'run2.mcap'), '-o',
                 str(folder / 'arm.json')]) == 0
    return folder


@pytest.fixture(scope='module')
def watched():
    with browsing() as page:
        yield page


@pytest.fixture(scope='module')
def diagnosed(folder):
    page = folder / 'diagnosed.html'
    assert main(['diagnose', str(folder / 'run1.mcap'), str(folder / 'run2.mcap'), '--model',
                 str(folder / 'arm.json'), '--html', str(page)]) == 0
    return page


def text_of(page: Path) -> str:
    return page.read_text()


def test_a_report_is_one_file_with_all_sections_in_order(diagnosed):
    html = text_of(diagnosed)
    assert re.findall(r'<section id="(\w+)">', html) == ORDER
    verdict = re.search(r'<h1[^>]*id="verdict">(.*?)</h1>', html)[1]
    assert 'Coulomb friction on joint shoulder' in verdict
    assert not re.search(r'<(script|link|img|iframe)[^>]*(src|href)=["\']?(https?:)?//', html)
    assert len(html) < 15e6
    for fact in ('coulomb_friction', 'run1.mcap', 'SHA-256', 'gravity_comp diagnose', '3.98 s1'):
        assert fact in html or fact == '3.98 s1'
    # It includes hash, version and command.
    assert re.search(r'[0-9a-f]{64}', html) and '0.1.0' in html


def test_compare_lists_the_errors_of_the_previous_model(folder, capsys):
    model, page = folder / 'added.json', folder / 'compared.html'
    model.write_bytes((folder / 'arm.json').read_bytes())
    assert main(['add', 'coulomb_friction:shoulder', '--model', str(model),
                 str(folder / 'run1.mcap'), str(folder / 'run2.mcap')]) == 0
    assert main(['compare', str(folder / 'run3.mcap'), '--model', str(model), '--html',
                 str(page)]) == 0
    capsys.readouterr()
    html = text_of(page)
    assert 'before coulomb_friction:shoulder N·m' in html and 'constant torque N·m' in html
    row = re.search(r'<th scope="row">shoulder</th>(.*?)</tr>', html)[1]
    cells = [float(x) for x in re.findall(r'<td class="number">([\d.]+)</td>', row)]
    # n, RMSE, std, largest, in training, before, constant torque
    rmse, before, constant = cells[1], cells[-2], cells[-1]
    assert rmse < 0.5 * before < 0.5 * constant


@pytest.mark.parametrize('bag, cause', [('other.mcap', 'shoulder'), ('none.mcap', 'none.mcap')])
def test_a_failure_is_reported_in_the_page(folder, capsys, bag, cause):
    page = folder / 'failed.html'
    assert main(['compare', str(folder / bag), '--model', str(folder / 'arm.json'), '--html',
                 str(page)]) == 1
    message = capsys.readouterr().err.split(': ', 1)[1].strip()
    html = text_of(page)
    assert cause in html and '<h1' in html and 'Traceback' not in html
    assert message.split('<')[0].split('"')[0].split("'")[0][:40] in html


@pytest.mark.parametrize('name', ['run1.mcap', 'report'])
def test_no_bag_is_overwritten_by_the_page(folder, capsys, name):
    before = (folder / 'run1.mcap').read_bytes()
    assert main(['compare', str(folder / 'run1.mcap'), '--model', str(folder / 'arm.json'),
                 '--html', str(folder / name)]) == 2
    assert 'does not end in .html' in capsys.readouterr().err
    assert (folder / 'run1.mcap').read_bytes() == before


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
        plots = tab.plots()
        # Per joint two plots over time, four residuals, two spectra; two heat maps; bars and more.
        assert len(plots) >= 2 * 8 + 3
        assert all(width > 60 and height > 25 for _, width, height in plots), plots
        # Every plot is painted when the page is ready, and none has a categorical axis, next to
        # which Bokeh leaves stray marks.
        kinds = page.evaluate(_kinds)
        assert kinds.count('Figure') == len(plots) and 'CategoricalAxis' not in kinds
        assert tab.selected()[0] == 0
        first, last = page.locator('#time .bk-Figure').first, page.locator('#time .bk-Figure').last
        # At the last joint the tools are still visible, and the cursor shows values.
        page.set_viewport_size({'width': 1280, 'height': 400})
        last.scroll_into_view_if_needed()
        tools, box = page.locator('#time .bk-Toolbar').bounding_box(), last.bounding_box()
        assert 0 <= tools['y'] < box['y'] and first.bounding_box()['y'] < 0
        page.mouse.move(box['x'] + 0.5 * box['width'], box['y'] + 0.5 * box['height'])
        page.locator('.bk-Tooltip').filter(
            has_text=re.compile(r'time.* s.*residual.* N·m', re.DOTALL)).first.wait_for()
        first.scroll_into_view_if_needed()
        tab.drag(first.bounding_box(), 0.2, 0.4)
        page.wait_for_function(f'({_selected_count}) > 0')
        rows, glyphs = tab.selected()
        # All plots share one table, so a selection is marked in all of them.
        assert 20 < rows < 1200 and glyphs >= 2 * (2 + 4)
        text = page.evaluate(_selection)
        assert f'<b>{rows} selected</b>: run1.mcap, ' in text
        assert re.search(r'[\d.]+ to [\d.]+ s. RMSE, N·m: shoulder [\d.]+, elbow [\d.]+</p>', text)
        page.wait_for_function(f'({_chosen_cells})()[0] > 0')
        marked = page.evaluate(_chosen_cells)
        assert marked[0] < marked[1], marked
        tab.picture('report')
        assert tab.complaints == [] and tab.requests == [] and tab.dialogs == []


@pytest.fixture(scope='module')
def large(tmp_path_factory):
    """Return a page with more samples than are drawn, of an arm with a description."""
    samples = two_links(count=24_000)
    slow = samples.select(np.arange(0, 24_000, 40))
    model = fit(slow, FitOptions('potential')).model
    contents = Contents(samples, predict_torque(model, samples), model, compare(model, slow), '',
                        (), Origin('', ''), arm=described_arm(two_link_urdf(), samples.names))
    page = tmp_path_factory.mktemp('large') / 'large.html'
    page.write_text(report_html(contents))
    return page, contents


def test_zooming_in_draws_more_samples_for_selection(large, watched):
    page, contents = large
    with watched(page.as_uri()) as tab:
        tab.open(page.as_uri())
        whole = np.array(tab.page.evaluate(_lines)[0])
        assert len(whole) < 7500
        # With Ctrl the wheel zooms both axes of a plot; over an axis it zooms that axis only.
        torque = tab.page.locator('#time .bk-Figure').first
        torque.scroll_into_view_if_needed()
        box = torque.bounding_box()
        tab.page.mouse.move(box['x'] + 0.5 * box['width'], box['y'] + 0.5 * box['height'])
        wide, high = tab.page.evaluate(_spans)
        tab.page.mouse.wheel(0, -10)
        assert tab.page.evaluate(_spans) == [wide, high]
        tab.page.keyboard.down('Control')
        tab.page.mouse.wheel(0, -100)
        tab.page.keyboard.up('Control')
        tab.page.wait_for_function(f'([wide, high]) => {{ const [w, h] = ({_spans})();'
                                   'return w < wide && h < high }', arg=[wide, high])
        last = tab.page.locator('#time .bk-Figure').last
        last.scroll_into_view_if_needed()
        box = last.bounding_box()
        tab.page.mouse.move(box['x'] + 0.5 * box['width'], box['y'] + box['height'] - 25)
        tab.page.keyboard.down('Control')
        for _ in range(4):
            tab.page.mouse.wheel(0, -300)
        tab.page.keyboard.up('Control')
        tab.page.wait_for_function(
            f'() => {{ const [t] = ({_lines})(); return t[t.length - 1] - t[0] < 300 }}')
        near, errors = tab.page.evaluate(_lines)
        inside = (contents.samples.t > near[0] - 1e-3) & (contents.samples.t < near[-1] + 1e-3)
        # All samples of the window, with their measured values.
        assert len(near) == inside.sum() > 2 * ((whole > near[0]) & (whole < near[-1])).sum()
        np.testing.assert_allclose(errors, contents.residual[inside, 0], atol=1e-4)
        tab.drag(box, 0.4, 0.6)
        tab.page.wait_for_function(f'({_selection})() != ""')
        text = tab.page.evaluate(_selection)
        count, start, end, rmse = map(float, re.search(
            r'<b>(\d+) selected</b>: .*?([\d.]+) to ([\d.]+) s.*shoulder ([\d.]+)', text).groups())
        chosen = tab.page.evaluate(_chosen)
        assert len(chosen) == count > 100
        assert [start, end] == pytest.approx(contents.samples.t[chosen][[0, -1]], abs=6e-3)
        assert rmse == pytest.approx(np.sqrt((contents.residual[chosen, 0] ** 2).mean()), abs=1e-3)
        assert tab.complaints == []


def test_a_server_draws_a_zoomed_window_from_all_samples(large):
    _, contents = large
    table = Table(contents)
    table.range.start, table.range.end = 100.0, 150.0
    table.follow_window()
    k, t = (table.lines.data[name] for name in 'kt')
    inside = np.flatnonzero((contents.samples.t >= 100.0) & (contents.samples.t <= 150.0))
    assert set(inside) <= set(k) and len(k) <= len(inside) + 2 > 900
    np.testing.assert_allclose(table.lines.data['r0'], contents.residual[k, 0], atol=1e-4)
    np.testing.assert_allclose(t, contents.samples.t[k], atol=1e-3)
    # The shared table is unchanged.
    assert len(table.source.data['t']) == len(table.rows) < 7500


def test_the_arm_follows_the_slider_and_the_selection(large, watched):
    page, contents = large
    with watched(page.as_uri()) as tab:
        tab.open(page.as_uri())
        status = tab.page.get_by_role('status')
        expect(status).to_contain_text('At 0.00 s: shoulder')
        expect(status).to_contain_text('Not yet visited: shoulder')
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
        tab.drag(tab.page.locator('#arm .bk-Figure').bounding_box(), 0.4, 0.6)
        turned = tab.page.evaluate(_capsules)
        before = status.inner_text()
        plot = tab.page.locator('#time .bk-Figure').first
        plot.scroll_into_view_if_needed()
        # A plot that is still laid out on a busy machine does not receive the first selection.
        changed = status.filter(has_not_text=before.split(':')[0])
        for _ in range(10):
            tab.drag(plot.bounding_box(), 0.7, 0.8)
            with suppress(AssertionError):
                expect(changed).to_be_visible(timeout=3000)
                break
        expect(changed).to_be_visible()
        time = float(re.search(r'At ([\d.]+) s', status.inner_text())[1])
        assert 0.6 * contents.samples.t[-1] < time < 0.9 * contents.samples.t[-1]
        assert tab.page.evaluate(_capsules) != turned
        tab.picture('report-arm')
        assert tab.complaints == [] and tab.requests == []


def test_a_narrow_dark_page_fits_all_its_plots(diagnosed, watched):
    with watched(diagnosed.as_uri(), color_scheme='dark') as tab:
        tab.page.set_viewport_size({'width': 400, 'height': 860})
        tab.open(diagnosed.as_uri())
        tab.page.wait_for_selector('html.dark')
        assert tab.page.evaluate('document.documentElement.scrollWidth') <= 400
        assert all(60 < width < 400 for _, width, _ in tab.plots())
        assert set(tab.page.evaluate(_grounds)) == {'#14181d'}
        assert tab.complaints == []


def test_print_is_light_with_unbroken_plots_and_coloured_keys(diagnosed, watched):
    with watched(diagnosed.as_uri(), color_scheme='dark') as tab:
        tab.page.set_viewport_size({'width': 1900, 'height': 860})
        tab.open(diagnosed.as_uri())
        tab.page.emulate_media(media='print', color_scheme='dark')
        colours = tab.page.evaluate(_paper)
        assert colours['ground'] == '#ffffff' and colours['keys'] == {'exact': colours['count']}
        # Dark plots are inverted; none is broken across pages.
        assert colours['plots'] and all(
            'invert(1)' in shown and whole == 'avoid' for shown, whole in colours['plots'])
        assert colours['tools'] == ['none'] * len(colours['tools']) != []
        assert tab.page.pdf().startswith(b'%PDF')
        assert tab.complaints == []


def test_names_with_markup_or_formulas_are_shown_as_text(folder, watched):
    page = folder / 'evil.html'
    assert main(['diagnose', str(folder / EVIL_BAG), '--html', str(page)]) == 0
    with watched(page.as_uri()) as tab:
        tab.open(page.as_uri())
        tab.page.wait_for_timeout(500)
        assert tab.dialogs == [] and tab.complaints == [] and tab.requests == []
        assert tab.page.evaluate(LIVELY) == []
        assert tab.page.evaluate('typeof MathJax') == 'undefined'
        assert tab.page.locator('#joints th[scope=row]').first.inner_text() == EVIL[0]
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


def found_on(contents, verdict='established', before=0.1, after=0.02, **more):
    """Return contents with one finding on a joint other than the worst."""
    joint = next(name for name in contents.joints if name != contents.worst)
    finding = Finding(joint, more.get('effect', 'coulomb_friction'), verdict, (), {}, before,
                      after, 0.0, 1.0, '', '')
    reports = {name: JointReport('', 0.1, 100.0, 0.2, 0.1, {}) for name in contents.joints}
    return replace(contents, diagnosis=Diagnosis((finding,), reports))


def test_the_headline_and_the_emphasised_row_name_the_same_joint(folder, watched):
    samples = concatenate(read_bag(folder / name).samples for name in ('run1.mcap', 'run2.mcap'))
    model = fit(slow_samples(samples).samples, FitOptions('potential')).model
    slow = slow_samples(samples).samples
    contents = Contents(samples, predict_torque(model, samples), model, compare(model, slow), '',
                        (), Origin('', ''))
    # The training data had the same friction, so no error is larger.
    sentence = headline(contents)
    assert sentence.startswith('The error is largest on shoulder')
    assert 'no error exceeds twice the training error' in sentence
    findings = found_on(contents)
    assert named_joint(contents) == 'shoulder' and named_joint(findings) == 'elbow'
    row = re.search(r'<tr class="strong"><th scope="row">(.*?)<', joints.section(findings).lead)
    assert row[1] == 'elbow'
    # An effect that changes no shown digit of the error is not reported as missing.
    assert headline(findings).startswith('Missing: Coulomb friction on joint elbow')
    same = found_on(contents, before=0.0025, after=0.002499)
    assert headline(same).startswith('No missing effect changes the error')
    assert '0.25 % of the range' in headline(same)
    # The name of an effect is escaped as well.
    evil = folder / 'effect.html'
    evil.write_text(report_html(found_on(contents, effect=EVIL[0])))
    assert '<img src=x' not in evil.read_text()
    with watched(evil.as_uri()) as tab:
        tab.open(evil.as_uri())
        assert EVIL[0] in tab.page.locator('#verdict').inner_text()
        assert tab.page.evaluate(LIVELY) == [] and tab.dialogs == [] and tab.complaints == []


_lines = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'ColumnDataSource' && model.get_column('r0') && !model.get_column('q0'))
      return [Array.from(model.get_column('t')), Array.from(model.get_column('r0'))]
}"""
_spans = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'Figure' && model.title && model.title.text == 'shoulder')
      return [model.x_range, model.y_range].map(range => range.end - range.start)
}"""
_chosen = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'ColumnDataSource' && model.get_column('r0') && !model.get_column('q0'))
      return model.selected.indices.map(row => model.get_column('k')[row])
}"""
_capsules = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'ColumnDataSource' && model.get_column('width'))
      return String(Array.from(model.get_column('x0')).slice(0, 200))
}"""
_selected_count = """(() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'ColumnDataSource' && model.get_column('q0') != null)
      return model.selected.indices.length
})()"""
_selection = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.name == 'selection') return model.text
}"""
_kinds = '() => [...Bokeh.documents[0]._all_models.values()].map(model => model.type)'
_grounds = """() => {
  const styles = []
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'Figure') styles.push(model.background_fill_color)
  return styles
}"""
_paper = """() => {
  const keys = [...document.querySelectorAll('.key i')].map(
    each => getComputedStyle(each).printColorAdjust)
  const styles = {ground: getComputedStyle(document.documentElement).getPropertyValue('--ground'),
                 count: keys.length, keys: {}, plots: [], tools: []}
  for (const each of keys) styles.keys[each] = (styles.keys[each] || 0) + 1
  const walk = (root) => {
    for (const element of root.querySelectorAll('*')) {
      const style = getComputedStyle(element)
      if (element.classList.contains('bk-Figure')) styles.plots.push(
        [style.filter, style.breakInside])
      if (element.classList.contains('bk-Toolbar')) styles.tools.push(style.display)
      if (element.shadowRoot) walk(element.shadowRoot)
    }
  }
  walk(document)
  return styles
}"""
_chosen_cells = """() => {
  for (const model of Bokeh.documents[0]._all_models.values())
    if (model.type == 'ColumnDataSource' && model.get_column('e0') != null)
      return [model.selected.indices.length, model.get_column('e0').length]
}"""
