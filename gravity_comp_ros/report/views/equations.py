"""Equations of the model, its applied effects, and the distribution of its weights."""

from __future__ import annotations

from bokeh.models import BasicTickFormatter, ColumnDataSource
from bokeh.plotting import figure
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import JointSelector, Section
from gravity_comp_ros.report.style import padded, plot, RESIDUAL, short
import numpy as np

_SHOWN, _MAX_TERMS = 8, 300
_MAX_STEMS = 1000


def section(contents: Contents, selector: JointSelector) -> Section:
    """Return equations, effects and weights."""
    model = contents.model
    lead = markup.paragraph(
        f'Formulation: {model.formulation}. s2 and c2 are sine and cosine of the angle of the '
        f'second joint; weights are in N·m, the largest first, as in Yu 2022, Table B.1.',
        'quiet')
    lead += ''.join(_equation(contents, n) for n in contents.numbers)
    applied = model.applied.effects
    if applied:
        lead += '<h3>Effects in addition to gravity</h3>' + markup.table(
            ['effect', 'on', 'coefficients, 95 %', 'nonlinear parameters'],
            [[e.name, e.joint or 'the whole arm',
              markup.units(wording.coefficients(e.coefficients, 6)),
              wording.settings(e) or '–'] for e in applied],
            left=('on', 'coefficients, 95 %', 'nonlinear parameters'))
    after = markup.paragraph(
        'The x axis is the index of the feature among the 3^N products of the dictionary. A '
        'sparse model has few weights, with a clear gap between large and small ones (compare '
        'Yu 2022, Figs. 8 and 11).', 'quiet')
    plots = selector.place(lambda k: [_stems(contents, contents.numbers[k])], 200)
    return Section('model', 'The model', lead, plots, after)


def terms(contents: Contents, n: int) -> list[tuple[float, str]]:
    """Return a joint's weights in N·m with their features, the largest first."""
    torque = contents.model.torques[n]
    order = np.argsort(-np.abs(torque.weights), kind='stable')
    count = contents.model.n_joints
    return [(float(torque.weights[k]),
             dictionary.feature_name(int(torque.indices[k]), count)) for k in order[:_MAX_TERMS]]


def _equation(contents: Contents, n: int) -> str:
    name, listed = contents.model.joints[n], terms(contents, n)
    count = len(contents.model.torques[n].weights)
    first = _sum(listed[:_SHOWN]) or '0'
    rest = count - min(_SHOWN, len(listed))
    html = f'<p class="equation"><b>{markup.text(name)}</b> = {first}'
    html += f' <span class="quiet">… {rest} more</span></p>' if rest else '</p>'
    if rest:
        note = '' if count <= _MAX_TERMS else markup.paragraph(
            f'The {_MAX_TERMS} largest of {count} terms; the model file lists all.', 'quiet')
        rows = [[f'{weight:.4f}', feature] for weight, feature in listed]
        html += markup.folded(f'all terms of {name}', note + markup.table(
            ['weight N·m', 'feature'], rows, left=('feature',)))
    return html


def _sum(weighted: list[tuple[float, str]]) -> str:
    html = ''
    for weight, feature in weighted:
        sign = ('−' if weight < 0 else '') if not html else (' − ' if weight < 0 else ' + ')
        html += f'{sign}<span>{abs(weight):.2f} {markup.text(feature)}</span>'
    return html


def _stems(contents: Contents, n: int) -> figure:
    torque, count = contents.model.torques[n], contents.model.n_joints
    largest = np.sort(np.argsort(-np.abs(torque.weights))[:_MAX_STEMS])
    indices, weights = torque.indices[largest], torque.weights[largest]
    source = ColumnDataSource({
        'x': indices.astype(np.float64), 'y': weights, 'zero': np.zeros(len(weights)),
        'name': [dictionary.feature_name(int(k), count) for k in indices]})
    fig = plot(f'{short(contents.model.joints[n])}: {len(torque.weights)} of {3 ** count}',
               'feature index', 'weight, N·m', 200, 'xbox_zoom,hover,reset,save',
               x_range=padded(0.0, 3.0 ** count, 0.03))
    fig.segment('x', 'zero', 'x', 'y', source=source, color=RESIDUAL, line_width=1.5)
    dots = fig.scatter('x', 'y', source=source, size=5, color=RESIDUAL)
    fig.hover.renderers = [dots]
    fig.hover.tooltips = [('feature', '@name'), ('weight', '@y{0.0000} N·m')]
    fig.xaxis.ticker.desired_num_ticks = 3
    fig.yaxis.formatter = BasicTickFormatter(use_scientific=False)
    return fig
