"""The workbench in a browser: the loop from a model to its effects, and the next motion."""

import re

from bench.shared.browser import expect, heap, ROOT, SELECTED
from bench.shared.rough_links import COULOMB, two_links
from bench.shared.workbench_page import (
    home, look, RMSE, rmse, row, saved, served, view_of)
from gravity_comp_ros.cli import main
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.planning.trajectory_files import read_trajectory
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest


def test_the_loop_in_a_browser(server, watched, tmp_path):
    address = server[0]
    with watched(home(address), color_scheme='light') as tab:
        page = tab.page
        tab.open(address)
        add = page.get_by_role('button', name='Add coulomb_friction:shoulder')
        add.wait_for()
        verdict = page.locator('#verdict')
        expect(verdict).to_contain_text('Missing: Coulomb friction on joint shoulder')
        # The first view has the errors, the evidence plot and the next command.
        tab.wait_for_plots(1)
        expect(view_of(page).locator('.command pre')).to_contain_text(
            'gravity_comp add coulomb_friction:shoulder')
        tab.picture('workbench')
        look(tab, 'Summary')
        rmse_before = rmse(page, 'shoulder')
        expect(verdict).to_contain_text(f'shoulder: {rmse_before} N·m RMSE')
        # By keyboard only.
        add.focus()
        page.keyboard.press('Enter')
        fall = page.locator('.fall')
        fall.wait_for()
        # The history, the table and the sentence show the same errors.
        before, after = re.findall(r'\d+\.\d+', fall.inner_text())
        assert before == rmse_before and float(after) < 0.5 * float(before)
        expect(row(page, 'shoulder').locator(RMSE)).to_have_text(after)
        expect(page.locator('#applied')).to_contain_text('coulomb_friction:shoulder')
        page.locator('#idle').wait_for()
        # The focus of a screen reader is on the result.
        page.wait_for_function("document.activeElement.id == 'head'")
        _compare_with_the_first_stage(tab, rmse_before)
        # Removed views do not stay in memory: the second round needs no more than the first.
        used = []
        for _ in range(2):
            for name in ('Residual', 'Summary'):
                look(tab, name)
            used.append(heap(page))
        assert used[1] < used[0] + 2.0
        look(tab, 'Over time')
        tab.select(view_of(page).locator('.bk-Figure').first, 0.2, 0.5)
        # The selection stays in another view.
        look(tab, 'Residual')
        tab.views.wait_for_function(f'({SELECTED})() > 20')
        assert tab.selected() < 1200
        _check_exports(page, tmp_path)
        page.get_by_role('button', name='Undo + coulomb_friction:shoulder').click()
        add.wait_for()
        look(tab, 'Summary')
        expect(row(page, 'shoulder').locator(RMSE)).to_have_text(rmse_before)
        expect(page.locator('#applied')).to_have_count(0)
        page.get_by_role('button', name='Dark or light').click()
        page.wait_for_selector('html.dark')
        tab.picture('workbench-dark')
        # A reload restores the session: both stages, with the first one selected.
        page.reload()
        add.wait_for()
        stages = page.get_by_label('Stage', exact=True)
        expect(stages.locator('option')).to_have_text([
            '1. gravity', '2. + coulomb_friction:shoulder (undone)'])
        stages.select_option(label='2. + coulomb_friction:shoulder (undone)')
        expect(page.locator('#applied')).to_contain_text('coulomb_friction:shoulder')
        assert tab.complaints == [] and tab.requests == [] and tab.dialogs == []


def _compare_with_the_first_stage(tab, rmse_before):
    """Show the errors of another model with those of the current one."""
    page = tab.page
    look(tab, 'Summary')
    page.get_by_label('Compare with').select_option(label='1. gravity')
    view_of(page).get_by_role('columnheader', name='1. gravity N·m').wait_for()
    expect(row(page, 'shoulder')).to_contain_text(rmse_before)


def _check_exports(page, folder):
    model = load_model(saved(page, 'Save the model', folder / 'saved.json'))
    effect = model.applied.effects[0]
    # Viscous friction is not modelled yet, so Coulomb friction absorbs part of it.
    assert effect.target == 'coulomb_friction:shoulder'
    assert effect.coefficients['F_c'].value == pytest.approx(COULOMB, abs=0.05)
    report = saved(page, 'Save a report', folder / 'report.html').read_text()
    assert 'id="verdict"' in report and 'coulomb_friction' in report
    lines = saved(page, 'Save command lines', folder / 'lines.sh').read_text()
    assert re.search('/run2.mcap --output arm.json --form.* --joints shoulder,elbow', lines)
    assert re.search('gravity_comp add coulomb_friction:shoulder .* --model arm.json', lines)


def test_a_motion_is_planned_for_an_open_finding(folder, watched, tmp_path):
    # Motion in one direction does not distinguish friction from an offset.
    write_bag(folder / 'one_way.mcap', [joint_states(two_links(1, one_way=True))])
    with served(folder, 'one_way.mcap') as (address, _), watched(home(address)) as tab:
        page = tab.page
        tab.open(address)
        ask = page.get_by_role('button', name='Plan a motion for all open findings')
        ask.wait_for()
        page.locator('#idle').wait_for()
        target = 'coulomb_friction:shoulder'
        ask.click()
        page.locator('#planned').wait_for()
        row = page.get_by_role('row', name=re.compile(f'^{target} '))
        expect(row).to_contain_text('F_c ±')
        # The chances before and after the motion, which an alternative makes less than certain.
        before, after = map(int, re.findall(r'(\d+) %', row.inner_text())[:2])
        assert before == 0 and after >= 90
        expect(page.locator('p.warning').filter(has_text='Move the arm to')).to_contain_text(
            'keep the space around the arm clear')
        page.locator('#idle').wait_for()
        motion = read_trajectory(saved(page, 'Save as trajectory', tmp_path / 'motion.yaml'))
        goal = read_trajectory(saved(page, 'Save as action goal', tmp_path / 'goal.yaml'))
        assert motion.joints == goal.joints == ('shoulder', 'elbow')
        assert np.ptp(motion.q[:, 0]) > 0.01 and abs(goal.qd).max() < 0.301
        tab.picture('workbench-plan')
        # A plan is discarded with its model.
        page.get_by_role('button', name='Fit with these settings').click()
        page.locator('#planned').wait_for(state='detached')
        assert tab.complaints == []


@pytest.mark.campaign
def test_a_fast_recording_of_seven_described_joints(folder, watched, tmp_path):
    bag, urdf = folder / 'fast.mcap', ROOT / 'bags' / 'iiwa7.urdf'
    assert main(['synth', '--motion', 'multisine', '--max-speed', '1.0', '--rate', '50',
                 '--noise', '0.05', '--duration', '30', '--hidden',
                 'coulomb_friction:iiwa_joint_4=0.8', '-o', str(bag)]) == 0
    with served(folder, bag.name, '--urdf', str(urdf)) as (address, _), watched(
            home(address), color_scheme='light') as tab:
        page = tab.page
        tab.open(address)
        # All samples are fitted, with the axes of the description and a warning.
        page.locator('.warning').filter(
            has_text='samples: all are fitted').first.wait_for()
        page.get_by_role('button', name=re.compile('^Add all')).wait_for()
        expect(page.get_by_label('Samples for fit and errors')).to_have_value('all samples')
        learned = load_model(saved(page, 'Save the model', tmp_path / 'learned.json'))
        assert learned.geometry is not None and learned.provenance['description']['source'] == str(
            urdf)
        page.get_by_role('button', name='Arm', exact=True).click()
        status = view_of(page).get_by_role('status').filter(has_text='iiwa_joint_1')
        status.filter(has_text='At 0.00 s').wait_for()
        view_of(page).get_by_role('slider').first.press('PageUp')
        status.filter(has_not_text='At 0.00 s').wait_for()
        # A new fit with another torque constant.
        page.get_by_text('Units and velocities').click()
        page.get_by_label('iiwa_joint_4', exact=True).last.fill('0.9')
        page.get_by_role('button', name='Fit with these settings').click()
        page.get_by_label('Stage', exact=True).locator('option').nth(1).wait_for(state='attached')
        scaled = load_model(saved(page, 'Save the model', tmp_path / 'scaled.json'))
        assert scaled.provenance['bags'][0]['effort_scale'] == {'iiwa_joint_4': 0.9}
        assert tab.complaints == []
