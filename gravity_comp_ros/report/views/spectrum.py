"""Spectra of the residual over time and over the joint angle."""

from __future__ import annotations

from bokeh.models import BasicTickFormatter, Select
from bokeh.plotting import figure
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, REPORT
from gravity_comp_ros.report.section import by_joint, Section
from gravity_comp_ros.report.style import FAINT, plot, RESIDUAL
import numpy as np

# Minimum length of a run for a spectrum over time.
_MIN_SAMPLES = 16


def over_time(samples: JointSamples, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return frequencies in Hz and the amplitude density of one joint's residual, N·m/sqrt(Hz).

    The spectrum is Welch's average over runs and their parts between gaps, weighted by their
    length, after interpolation to a uniform grid. Both arrays are empty if no part has 16 samples.

    :param residual: (M,) in N·m.
    """
    steps, same = np.diff(samples.t), np.diff(samples.runs) == 0
    step = float(np.median(steps[same])) if same.any() else 1.0
    ends = np.flatnonzero(~same | (steps > FACTS.gap_steps * step)) + 1
    grids = [(np.arange(t[0], t[-1], step), t, values)
             for t, values in zip(np.split(samples.t, ends), np.split(residual, ends))
             if len(t) >= _MIN_SAMPLES]
    if not grids:
        return np.zeros(0), np.zeros(0)
    from scipy import signal  # imported here because it takes 0.5 s
    sizes = [len(grid) for grid, _, _ in grids]
    length = min(REPORT.max_segment, *sizes)
    power = np.average([signal.welch(np.interp(*each), 1.0 / step, nperseg=length)[1]
                        for each in grids], axis=0, weights=sizes)
    frequency = np.asarray(np.fft.rfftfreq(length, step)[1:], dtype=np.float64)
    return frequency, np.asarray(np.sqrt(power[1:]))


def over_angle(q: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return orders (cycles per revolution) and amplitudes in N·m of one joint's residual.

    They are those of the Lomb-Scargle periodogram, so poses may be uneven. The lowest order is one
    cycle over the visited range. Both arrays are empty if the joint
    travels less than 0.05 rad.

    :param q: the joint's angle (M,) in rad.
    :param residual: (M,) in N·m.
    """
    travel = float(np.ptp(q)) if len(q) else 0.0
    if travel < REPORT.min_travel:
        return np.zeros(0), np.zeros(0)
    rows = np.arange(0, len(q), max(1, len(q) // REPORT.max_rows))
    q, residual = q[rows], residual[rows] - residual[rows].mean()
    lowest = 2.0 * np.pi / travel
    count = int(REPORT.max_order / (REPORT.order_step * lowest)) + 1
    orders = REPORT.order_step * lowest * np.arange(2.0, count)
    from scipy import signal  # imported here because it takes 0.5 s
    power = signal.lombscargle(q, residual, orders)
    return orders, np.asarray(2.0 * np.sqrt(np.maximum(power, 0.0) / len(q)))


_HEIGHT = 190
_TOOLS = 'xpan,xbox_zoom,hover,crosshair,reset,save'


def section(contents: Contents, selector: Select) -> Section:
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
    return Section('spectrum', 'Spectrum of the residual', lead, by_joint(selector, plots, 300))


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
