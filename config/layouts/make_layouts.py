"""
Write the PlotJuggler and the Foxglove layout for an arm.

    python3 make_layouts.py [JOINT ...] [--folder F] [--joint-states TOPIC]

Without joints, for those of a KUKA LBR iiwa. Measured, predicted and residual torque of every
joint, in the output of `gravity_comp replay` as well as live from `gravity_comp_node`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

IIWA = tuple(f'iiwa_joint_{k}' for k in range(1, 8))
PREDICTION, RESIDUAL = '/gravity_comp/prediction', '/gravity_comp/residual'
TORQUES, EXTRAPOLATION = '/gravity_comp/gravity_torques', '/gravity_comp/extrapolation'
MEASURED_COLOUR, PREDICTED_COLOUR, RESIDUAL_COLOUR = '#1f77b4', '#d62728', '#2ca02c'
FED_COLOUR, OUTSIDE_COLOUR = '#ff7f0e', '#9467bd'

Curve = tuple[str, str, str]


def torque_curves(measured: str) -> tuple[Curve, ...]:
    """Return topic, label and colour of each curve in a joint's plot."""
    return ((measured, 'measured', MEASURED_COLOUR),
            (PREDICTION, 'predicted', PREDICTED_COLOUR),
            (TORQUES, 'feed-forward', FED_COLOUR))


def plotjuggler(joints: Sequence[str], measured: str) -> str:
    """Return a PlotJuggler layout; there a joint state's fields are TOPIC/JOINT/effort."""
    root = ElementTree.Element('root')
    tabs = ElementTree.SubElement(root, 'tabbed_widget', name='Main Window',
                                  parent='main_window')
    for title, curves, field in (
            ('torque', torque_curves(measured), 'effort'),
            ('residual', ((RESIDUAL, 'residual', RESIDUAL_COLOUR),), 'effort'),
            ('outside the trained range',
             ((EXTRAPOLATION, 'outside', OUTSIDE_COLOUR),), 'position')):
        tab = ElementTree.SubElement(tabs, 'Tab', tab_name=title, containers='1')
        container = ElementTree.SubElement(tab, 'Container')
        share = ';'.join([f'{1 / len(joints):.6f}'] * len(joints))
        split = ElementTree.SubElement(container, 'DockSplitter', orientation='-',
                                       count=str(len(joints)), sizes=share)
        for joint in joints:
            area = ElementTree.SubElement(split, 'DockArea', name=joint)
            plot = ElementTree.SubElement(area, 'plot', mode='TimeSeries', style='Lines',
                                          flip_x='false', flip_y='false')
            ElementTree.SubElement(plot, 'limitY')
            for topic, _, colour in curves:
                ElementTree.SubElement(plot, 'curve', name=f'{topic}/{joint}/{field}',
                                       color=colour)
    ElementTree.SubElement(tabs, 'currentTabIndex', index='0')
    ElementTree.SubElement(root, 'use_relative_time_offset', enabled='1')
    ElementTree.indent(root, ' ')
    return "<?xml version='1.0' encoding='UTF-8'?>\n" \
        + ElementTree.tostring(root, encoding='unicode') + '\n'


def foxglove(joints: Sequence[str], measured: str) -> str:
    """Return a Foxglove layout; there a joint is its place in the message."""
    panels: dict[str, Any] = {}
    for k, joint in enumerate(joints):
        panels[f'Plot!torque{k + 1}'] = _plot(f'{joint}: torque', [
            (f'{topic}.effort[{k}]', label, colour)
            for topic, label, colour in torque_curves(measured)])
        panels[f'Plot!residual{k + 1}'] = _plot(f'{joint}: residual', [
            (f'{RESIDUAL}.effort[{k}]', 'residual', RESIDUAL_COLOUR)])
    panels['DiagnosticSummary!gravity'] = {
        'topicToRender': '/diagnostics', 'hardwareIdFilter': 'gravity_comp', 'minLevel': 0,
        'pinnedIds': [], 'sortByLevel': True}
    rows = [{'direction': 'row', 'splitPercentage': 60, 'first': f'Plot!torque{k + 1}',
             'second': f'Plot!residual{k + 1}'} for k in range(len(joints))]
    layout = {'configById': panels, 'globalVariables': {}, 'userNodes': {},
              'playbackConfig': {'speed': 1},
              'layout': {'direction': 'row', 'splitPercentage': 80, 'first': _column(rows),
                         'second': 'DiagnosticSummary!gravity'}}
    return json.dumps(layout, indent=1) + '\n'


def _plot(title: str, curves: Sequence[Curve]) -> dict[str, Any]:
    paths = [{'value': path, 'label': label, 'color': colour, 'enabled': True,
              'timestampMethod': 'headerStamp'} for path, label, colour in curves]
    return {'foxglovePanelTitle': title, 'paths': paths, 'showXAxisLabels': True,
            'showYAxisLabels': True, 'showLegend': True, 'legendDisplay': 'floating',
            'showPlotValuesInLegend': False, 'isSynced': True, 'xAxisVal': 'timestamp',
            'yAxisLabel': 'N·m'}


def _column(rows: Sequence[Any]) -> Any:
    if len(rows) == 1:
        return rows[0]
    half = len(rows) // 2
    return {'direction': 'column', 'splitPercentage': 100 * half / len(rows),
            'first': _column(rows[:half]), 'second': _column(rows[half:])}


def main(arguments: Sequence[str] | None = None) -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description='PlotJuggler and Foxglove layouts for an arm.')
    parser.add_argument('joints', nargs='*', default=IIWA, metavar='JOINT')
    parser.add_argument('--folder', type=Path, default=Path('.'))
    parser.add_argument('--joint-states', default='/joint_states', metavar='TOPIC')
    args = parser.parse_args(arguments)
    joints = tuple(args.joints)
    (args.folder / 'plotjuggler.xml').write_text(plotjuggler(joints, args.joint_states),
                                                 encoding='utf-8')
    (args.folder / 'foxglove.json').write_text(foxglove(joints, args.joint_states),
                                               encoding='utf-8')


if __name__ == '__main__':
    main()
