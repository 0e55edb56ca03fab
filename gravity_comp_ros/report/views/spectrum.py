"""Spectra of the residual over time and over the joint angle."""

from __future__ import annotations

from bokeh.models import BasicTickFormatter
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import JointSelector, Section
from gravity_comp_ros.report.spectra import over_angle, over_time
from gravity_comp_ros.report.style import FAINT, plot, RESIDUAL

_HEIGHT = 190
_TOOLS = 'xpan,xbox_zoom,hover,crosshair,reset,save'


def section(contents: Contents, selector: JointSelector) -> Section:
    """Return two plots per joint."""
    def plots(k: int) -> list[figure]:
        n = contents.numbers[k]
        residual = contents.residual[:, n]
        return [_plot(contents.joints[k], 'frequency, Hz', 'N·m/√Hz',
                      over_time(contents.samples, residual), True,
                      'The recording is too short for a spectrum'),
                _plot('', 'cycles per revolution', 'N·m',
                      over_angle(contents.samples.q[:, n], residual), False,
                      'The joint hardly moves')]

    lead = markup.paragraph(
        'Left, over time: noise is flat, unmodelled effects appear at low frequencies, motor or '
        'mains interference as a line. Right, over the angle: a line at an integer number of '
        'cycles per revolution indicates a gear or a bearing.', 'quiet')
    return Section('spectrum', 'Spectrum of the residual', lead, selector.place(plots, 300))


def _plot(title: str, x_label: str, y_label: str, points: tuple[FloatArray, FloatArray],
          is_logarithmic: bool, empty: str) -> figure:
    x, y = points
    kind = 'log' if is_logarithmic and len(x) else 'linear'
    fig = plot(title, x_label, y_label, _HEIGHT, _TOOLS, x_axis_type=kind, y_axis_type=kind)
    if not len(x):
        fig.text([0.0], [0.0], [empty], text_color=FAINT, text_align='center',
                 text_baseline='middle', text_font_size='13px')
        fig.axis.visible = fig.grid.visible = False
        return fig
    y = y.clip(min=float(y[y > 0].min()) if (y > 0).any() else 1e-12)
    fig.line(x, y, color=RESIDUAL, line_width=1.2)
    fig.yaxis.ticker.desired_num_ticks = 3
    if not is_logarithmic:
        fig.yaxis.formatter = BasicTickFormatter(use_scientific=False)
        fig.varea(x, [0.0] * len(x), y, fill_color=RESIDUAL, fill_alpha=0.25)
    fig.hover.tooltips = [(x_label.split(',')[0], '@x{0.000}'), (y_label, '@y{0.0000}')]
    return fig
