"""Line plots as SVG of a few kB, without a plotting library or fonts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from bench.paper.scenes import FloatArray
import numpy as np

_COLOURS = ('#1f1f1f', '#d1495b', '#00798c', '#edae49')
_WIDTH, _HEIGHT, _LEFT, _TOP, _GAP = 720, 150, 62, 26, 34
_POINTS = 200


@dataclass(frozen=True)
class Panel:
    """One set of axes: lines (name, x, y) under a title."""

    title: str
    lines: Sequence[tuple[str, FloatArray, FloatArray]]


def plot(panels: Sequence[Panel], x_label: str, y_label: str) -> str:
    """Return a figure of stacked panels."""
    total = _TOP + len(panels) * (_HEIGHT + _GAP) + 24
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {total}" '
             f'font-family="sans-serif" font-size="11">',
             f'<rect width="{_WIDTH}" height="{total}" fill="white"/>', _legend(panels[0])]
    for number, panel in enumerate(panels):
        parts += _axes(panel, _TOP + 18 + number * (_HEIGHT + _GAP), y_label)
    parts += [f'<text x="{_WIDTH / 2}" y="{total - 6}" text-anchor="middle">'
              f'{escape(x_label)}</text>', '</svg>']
    return '\n'.join(parts) + '\n'


def _legend(panel: Panel) -> str:
    step = 165
    return ''.join(
        f'<line x1="{_LEFT + k * step}" x2="{_LEFT + 18 + k * step}" y1="12" y2="12" '
        f'stroke="{_COLOURS[k]}" stroke-width="2"/>'
        f'<text x="{_LEFT + 23 + k * step}" y="16">{escape(name)}</text>'
        for k, (name, _, _) in enumerate(panel.lines))


def _axes(panel: Panel, top: float, y_label: str) -> list[str]:
    x = np.concatenate([line[1] for line in panel.lines])
    y = np.concatenate([line[2] for line in panel.lines])
    (x0, x1), (y0, y1) = (float(x.min()), float(x.max())), _range(y)
    right, bottom = _WIDTH - 12, top + _HEIGHT

    def across(values: FloatArray) -> FloatArray:
        return _LEFT + (values - x0) / (x1 - x0) * (right - _LEFT)

    def down(values: FloatArray) -> FloatArray:
        return bottom - (values - y0) / (y1 - y0) * _HEIGHT
    parts = [f'<rect x="{_LEFT}" y="{top}" width="{right - _LEFT}" height="{_HEIGHT}" '
             f'fill="none" stroke="#999"/>',
             f'<text x="{_LEFT}" y="{top - 4}" font-weight="bold">{escape(panel.title)}</text>',
             f'<text x="{right}" y="{top - 4}" text-anchor="end">{escape(y_label)}</text>']
    for value in np.linspace(y0, y1, 3):
        parts.append(f'<text x="{_LEFT - 5}" y="{down(np.array(value)) + 4:.1f}" '
                     f'text-anchor="end">{value:.3g}</text>')
    for value in np.linspace(x0, x1, 5):
        parts.append(f'<text x="{across(np.array(value)):.1f}" y="{bottom + 13}" '
                     f'text-anchor="middle">{value:.3g}</text>')
    for k, (_, xs, ys) in enumerate(panel.lines):
        few = np.linspace(0, len(xs) - 1, min(len(xs), _POINTS)).astype(int)
        points = ' '.join(f'{a:.1f},{b:.1f}' for a, b in zip(across(xs[few]), down(ys[few])))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{_COLOURS[k]}" '
                     f'stroke-width="{1.6 if k else 2.2}"/>')
    return parts


def _range(values: FloatArray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    margin = 0.05 * max(high - low, 1e-3)
    return low - margin, high + margin
