"""Two models side by side, on the same samples."""

from __future__ import annotations

from bokeh.models import ColumnDataSource, FactorRange, UIElement
from bokeh.transform import dodge
from gravity_comp_ros.diagnosis.wording import percent
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.style import canvas_text, dress_legend, plot, Style


def section(name: str, here: Comparison, other_name: str, other: Comparison,
            style: Style) -> Section:
    """Return a table and bars of both models' errors, joint by joint."""
    joints = [joint for joint in here.joints if joint in other.joints]
    rows = []
    for joint in joints:
        a, b = here.joints[joint], other.joints[joint]
        change = f'{100.0 * (a.rmse / b.rmse - 1.0):+.0f} %' if b.rmse > 0.0 else '–'
        rows.append([joint, f'{b.rmse:.4f}', f'{a.rmse:.4f}', change, percent(b.nrmse),
                     percent(a.nrmse), f'{b.max_abs:.3f}', f'{a.max_abs:.3f}'])
    table = markup.table(
        ['joint', 'RMSE N·m, A', 'RMSE N·m, B', 'change', 'nRMSE, A', 'nRMSE, B',
         'largest N·m, A', 'largest N·m, B'], rows)
    lead = markup.paragraph(f'A is {other_name}, B is {name}; on the slow part of the chosen '
                            f'runs.') + table
    return Section('compare', f'{name} against {other_name}', lead,
                   _bars(joints, here, other, name, other_name, style))


def _bars(joints: list[str], here: Comparison, other: Comparison, name: str, other_name: str,
          style: Style) -> UIElement:
    shown = [canvas_text(printable(joint)) for joint in joints]
    source = ColumnDataSource({'joint': shown,
                               'here': [here.joints[j].rmse for j in joints],
                               'other': [other.joints[j].rmse for j in joints]})
    made = plot(style, 'RMSE of both models', 'N·m', '', 110 + 34 * len(joints), 'hover,save',
                y_range=FactorRange(*shown[::-1]))
    made.hbar(dodge('joint', 0.17, range=made.y_range), right='other', height=0.3,
              source=source, color=style.before, legend_label=canvas_text(printable(other_name)))
    made.hbar(dodge('joint', -0.17, range=made.y_range), right='here', height=0.3,
              source=source, color=style.after, legend_label=canvas_text(printable(name)))
    made.x_range.start = 0.0
    made.ygrid.visible = False
    made.yaxis.major_tick_line_color = made.yaxis.separator_line_color = None
    made.hover.tooltips = [('first', '@other{0.0000} N·m'), ('second', '@here{0.0000} N·m')]
    made.add_layout(made.legend[0], 'above')
    made.legend.orientation = 'horizontal'
    dress_legend(made, style)
    made.toolbar_location = None
    return made
