"""Spectra of the residual over time and over the joint angle."""

from __future__ import annotations

from bokeh.models import BasicTickFormatter, CrosshairTool
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.spectra import over_angle, over_time
from gravity_comp_ros.report.style import plot, Style
from gravity_comp_ros.report.tiles import tiles

_HEIGHT = 190
_TOOLS = 'xpan,xbox_zoom,hover,reset,save'


def section(contents: Contents, style: Style) -> Section:
    """Return two plots per joint."""
    rows = []
    for n in contents.numbers:
        name = contents.model.joints[n]
        frequency, density = over_time(contents.samples, contents.residual[:, n])
        order, amplitude = over_angle(contents.samples.q[:, n], contents.residual[:, n])
        rows.append([
            _plot(style, name, 'frequency, Hz', 'N·m/√Hz', frequency, density, True,
                  'The recording is too short for a spectrum'),
            _plot(style, '', 'cycles per revolution', 'N·m', order, amplitude, False,
                  'The joint hardly moves')])
    grid = tiles(rows, 300)
    lead = markup.paragraph(
        'Left, over time: noise is flat, unmodelled effects appear at low frequencies, motor or '
        'mains interference as a line. Right, over the angle: a line at an integer number of '
        'cycles per revolution indicates a gear or a bearing.', 'quiet')
    return Section('spectrum', 'Spectrum of the residual', lead, grid)


def _plot(style: Style, title: str, x_label: str, y_label: str, x: FloatArray, y: FloatArray,
          logarithmic: bool, empty: str) -> figure:
    kind = 'log' if logarithmic and len(x) else 'linear'
    fig = plot(style, title, x_label, y_label, _HEIGHT, _TOOLS, x_axis_type=kind,
               y_axis_type=kind)
    if not len(x):
        fig.text([0.0], [0.0], [empty], text_color=style.faint, text_align='center',
                 text_baseline='middle', text_font_size='13px')
        fig.axis.visible = False
        fig.grid.visible = False
        return fig
    floor = float(y[y > 0].min()) if (y > 0).any() else 1e-12
    y = y.clip(min=floor)
    fig.line(x, y, color=style.residual, line_width=1.2)
    fig.yaxis.ticker.desired_num_ticks = 3
    if not logarithmic:
        fig.yaxis.formatter = BasicTickFormatter(use_scientific=False)
        fig.varea(x, [0.0] * len(x), y, fill_color=style.residual, fill_alpha=0.25)
    fig.hover.tooltips = [(x_label.split(',')[0], '@x{0.000}'), (y_label, '@y{0.0000}')]
    fig.add_tools(CrosshairTool(dimensions='height', line_color=style.faint))
    return fig
