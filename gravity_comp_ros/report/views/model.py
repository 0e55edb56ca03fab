"""Equations of the model and its weights, quality of the data, and provenance of both."""

from __future__ import annotations

from collections.abc import Mapping

from gravity_comp_ros import __version__
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.display import percent, shortened, TextTable
from gravity_comp_ros.facts.motion import MOTION
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.printable import counted
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents, REPORT
from gravity_comp_ros.report.section import Section
import numpy as np


def section(contents: Contents) -> Section:
    """Return equations, effects and weights."""
    model = contents.model
    lead = markup.paragraph(
        f'Formulation: {model.formulation}. s2 and c2 are sine and cosine of the angle of the '
        f'second joint; weights are in N·m, the largest first, as in Yu 2022, Table B.1.',
        'quiet')
    lead += ''.join(_equation(contents, n) for n in contents.numbers)
    applied = model.applied.effects
    if applied:
        lead += '<h3>Effects in addition to gravity</h3>' + TextTable(
            ('effect', 'on', 'coefficients, 95 %', 'nonlinear parameters'),
            [[e.name, e.joint or 'the whole arm',
              markup.units(wording.coefficients(e.coefficients, 6)),
              wording.settings(e) or '–'] for e in applied]).html()
    return Section('model', 'The model', lead)


def _equation(contents: Contents, n: int) -> str:
    model, torque = contents.model, contents.model.torques[n]
    name, count = model.joints[n], len(torque.weights)
    html = (f'<p class="equation"><b>{markup.text(name)}</b> = '
            f'{markup.text(shortened(model.equation(name), REPORT.shown_terms))}</p>')
    if count <= REPORT.shown_terms:
        return html
    order = np.argsort(-np.abs(torque.weights), kind='stable')
    features = dictionary.feature_names(torque.indices[order], model.n_joints)
    return html + markup.folded(f'all terms of {name}', TextTable(
        ('weight N·m', 'feature'),
        [[f'{weight:.4f}', feature]
         for weight, feature in zip(torque.weights[order], features)]).html())


def quality(contents: Contents) -> Section:
    """Return tables of the recordings and of the motion of each joint."""
    facts = contents.facts
    recordings = [[r.path.name, r.topic, r.n_messages, r.n_samples, f'{r.rate_hz:.4g}',
                   f'{r.duration_s:.1f}', r.velocity,
                   '; '.join(f'{count} {reason}' for reason, count in r.dropped.items() if count)
                   or 'none'] for r in contents.reports]
    html = TextTable(('recording', 'topic', 'messages', 'samples', 'rate Hz', 'length s',
                      'velocity', 'dropped'), recordings).html()
    html += markup.bullets(f'{r.path.name}: {note}' for r in contents.reports for note in r.notes)
    joints = {name: facts.joints[name] for name in contents.joints}
    html += TextTable(('joint', *MOTION, 'torque variance explained by pose'), [
        (name, *joint.cells(), percent(joint.pose_share))
        for name, joint in joints.items()]).html()
    html += markup.paragraph(
        f'{100 * facts.slow_share:.0f} % of the samples are slow motion.')
    html += markup.bullets(facts.remarks)
    return Section('quality', 'Quality of the data', html)


def provenance(contents: Contents) -> Section:
    """Return command, versions, files with their hashes, and the model's history."""
    model = contents.model
    lines = '\n'.join(markup.text(line) for line in contents.command.splitlines())
    html = f'<pre tabindex="0">{lines}</pre>'
    rows = [['created', contents.when], ['gravity_comp_ros', __version__],
            ['numpy', np.__version__], ['model', contents.model_file or 'fitted for this report'],
            ['formulation', model.formulation],
            ['trained on', f'{model.coverage.n_samples} samples of '
             f'{counted(model.coverage.n_runs, "run")}']]
    html += TextTable(('what', 'value'), rows).html()
    html += TextTable(('recording', 'SHA-256'),
                      [[r.path.name, r.sha256] for r in contents.reports]).html()
    fitted = model.provenance.get('bags', ())
    if fitted:
        html += TextTable(
            ('the model was fitted to', 'SHA-256'),
            [[bag.get('name', '?'), bag.get('sha256', '?')] for bag in fitted]).html()
    steps = model.history
    if steps:
        html += TextTable(
            ('step', 'effects', 'when', 'held-out RMSE N·m'),
            [[s.action, ', '.join(s.effects), s.when, _changes(s.before, s.after)]
             for s in steps]).html()
    html += markup.bullets(contents.notes)
    return Section('provenance', 'Provenance', html)


def _changes(before: Mapping[str, float], after: Mapping[str, float]) -> str:
    parts = [f'{name} {before[name]:.3g} → {after[name]:.3g}' for name in after
             if name in before and abs(after[name] - before[name]) > 0.02 * before[name]]
    return ', '.join(parts) or '–'
