"""The model as equations, the largest term first, and how its weights are distributed."""

from __future__ import annotations

from bokeh.models import BasicTickFormatter, ColumnDataSource, UIElement
from bokeh.plotting import figure
from gravity_comp_ros.api.results import effect_numbers
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.style import padded, plot, Style
from gravity_comp_ros.report.tiles import tiles
import numpy as np

_SHOWN, _MOST_TERMS = 8, 300
_MOST_STEMS, _COLUMNS = 1000, 4


def section(contents: Contents, style: Style) -> Section:
    """Return equations, effects and weights."""
    model = contents.model
    lead = markup.paragraph(
        f'Formulation {model.formulation}. s2 and c2 are sine and cosine of the angle of the '
        f'second joint; weights are in N·m, the largest first, as in Yu 2022, Table B.1.',
        'quiet')
    lead += ''.join(_equation(contents, n) for n in contents.numbers)
    applied = model.applied.effects
    if applied:
        lead += '<h3>Effects besides gravity</h3>' + markup.table(
            ['effect', 'on', 'coefficients, 95 %', 'setting'],
            [[e.name, e.joint or 'the whole arm', numbers(e),
              ', '.join(f'{k} {x:.3g}' for k, x in e.setting.items()) or '–'] for e in applied],
            left=('on', 'coefficients, 95 %', 'setting'))
    plots = _weights(contents, style)
    after = markup.paragraph(
        'Left to right are the numbers of the features among the 3^N products of the '
        'dictionary; a sparse model has few weights, and its large ones stand clear of the '
        'small ones (compare Yu 2022, Figs. 8 and 11).', 'quiet') if plots else ''
    return Section('model', 'The model', lead, plots, after)


def numbers(effect: AppliedEffect, most: int = 6) -> str:
    """Return an effect's coefficients with units and intervals in one line."""
    return markup.units(', '.join(effect_numbers(effect, most)))


def terms(contents: Contents, n: int) -> list[tuple[float, str]]:
    """Return a joint's weights in N·m with their features, the largest first."""
    torque = contents.model.torques[n]
    order = np.argsort(-np.abs(torque.weights), kind='stable')
    count = contents.model.n_joints
    return [(float(torque.weights[k]),
             dictionary.feature_name(int(torque.indices[k]), count)) for k in order[:_MOST_TERMS]]


def _equation(contents: Contents, n: int) -> str:
    name, found = contents.model.joints[n], terms(contents, n)
    many = len(contents.model.torques[n].weights)
    first = _sum(found[:_SHOWN]) or '0'
    rest = many - min(_SHOWN, len(found))
    html = f'<p class="equation"><b>{markup.text(name)}</b> = {first}'
    html += f' <span class="quiet">… {rest} more</span></p>' if rest else '</p>'
    if rest:
        cut = '' if many <= _MOST_TERMS else markup.paragraph(
            f'The {_MOST_TERMS} largest of {many} terms; the model file has them all.', 'quiet')
        rows = [[f'{weight:.4f}', feature] for weight, feature in found]
        html += markup.folded(f'all terms of {name}', cut + markup.table(
            ['weight N·m', 'feature'], rows, left=('feature',)))
    return html


def _sum(found: list[tuple[float, str]]) -> str:
    html = ''
    for weight, feature in found:
        sign = ('−' if weight < 0 else '') if not html else (' − ' if weight < 0 else ' + ')
        html += f'{sign}<span>{abs(weight):.2f} {markup.text(feature)}</span>'
    return html


def _weights(contents: Contents, style: Style) -> UIElement | None:
    made = [_stems(contents, n, style) for n in contents.numbers
            if len(contents.model.torques[n].weights)]
    if not made:
        return None
    rows = [made[k:k + _COLUMNS] for k in range(0, len(made), _COLUMNS)]
    return tiles(rows, 200)


def _stems(contents: Contents, n: int, style: Style) -> figure:
    torque, count = contents.model.torques[n], contents.model.n_joints
    largest = np.sort(np.argsort(-np.abs(torque.weights))[:_MOST_STEMS])
    indices, weights = torque.indices[largest], torque.weights[largest]
    source = ColumnDataSource({
        'x': indices.astype(np.float64), 'y': weights, 'zero': np.zeros(len(weights)),
        'name': [dictionary.feature_name(int(k), count) for k in indices]})
    kept = len(torque.weights)
    made = plot(style, f'{contents.model.joints[n]}: {kept} of {3 ** count}',
                'feature number', 'weight, N·m', 200, 'xbox_zoom,hover,reset,save',
                x_range=padded(0.0, 3.0 ** count, 0.03))
    made.segment('x', 'zero', 'x', 'y', source=source, color=style.residual, line_width=1.5)
    dots = made.scatter('x', 'y', source=source, size=5, color=style.residual)
    made.hover.renderers = [dots]
    made.hover.tooltips = [('feature', '@name'), ('weight', '@y{0.0000} N·m')]
    made.xaxis.ticker.desired_num_ticks = 3
    made.yaxis.formatter = BasicTickFormatter(use_scientific=False)
    return made
