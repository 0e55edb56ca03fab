"""Data of a report: quality of the recordings, command, versions, files and model history."""

from __future__ import annotations

from collections.abc import Mapping

from gravity_comp_ros import __version__
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
import numpy as np


def quality(contents: Contents) -> Section:
    """Return tables of the recordings and of the motion of each joint."""
    facts = contents.facts
    recordings = [[r.path.name, r.topic, r.n_messages, r.n_samples, f'{r.rate_hz:.4g}',
                   f'{r.duration_s:.1f}', r.velocity,
                   '; '.join(f'{count} {reason}' for reason, count in r.dropped.items() if count)
                   or 'none'] for r in contents.reports]
    html = markup.table(['recording', 'topic', 'messages', 'samples', 'rate Hz', 'length s',
                         'velocity', 'dropped'], recordings, left=('topic', 'velocity', 'dropped'))
    html += markup.bullets(f'{r.path.name}: {note}' for r in contents.reports for note in r.notes)
    rows = []
    for name in contents.joints:
        joint = facts.joints[name]
        rows.append([name, f'{joint.q_min:.2f} … {joint.q_max:.2f}', f'{joint.max_speed:.3f}',
                     f'{joint.rms_speed:.3f}',
                     'at rest' if joint.reversals is None else joint.reversals,
                     f'{joint.tau_min:.2f} … {joint.tau_max:.2f}',
                     '–' if joint.pose_share is None else f'{100 * joint.pose_share:.0f} %'])
    html += markup.table(['joint', 'range rad', 'fastest rad/s', 'RMS rad/s', 'reversals',
                          'torque N·m', 'torque variance explained by pose'], rows)
    html += markup.paragraph(
        f'{100 * facts.slow_share:.0f} % of the samples are slow motion.')
    html += markup.bullets(facts.remarks)
    return Section('quality', 'Quality of the data', html)


def section(contents: Contents) -> Section:
    """Return command, versions, files with their hashes, and the model's history."""
    origin, model = contents.origin, contents.model
    lines = '\n'.join(markup.text(line) for line in origin.command.splitlines())
    html = f'<pre tabindex="0">{lines}</pre>'
    rows = [['created', origin.when], ['gravity_comp_ros', __version__], ['numpy', np.__version__],
            ['model', origin.model_file or 'fitted for this report'],
            ['formulation', model.formulation],
            ['trained on', f'{model.coverage.n_samples} samples of {model.coverage.n_runs} runs']]
    html += markup.table(['what', 'value'], rows, left=('value',))
    html += markup.table(['recording', 'SHA-256'],
                         [[r.path.name, r.sha256] for r in contents.reports], left=('SHA-256',))
    fitted = model.provenance.get('bags', ())
    if fitted:
        html += markup.table(['the model was fitted to', 'SHA-256'],
                             [[bag.get('name', '?'), bag.get('sha256', '?')] for bag in fitted],
                             left=('SHA-256',))
    steps = model.history
    if steps:
        html += markup.table(
            ['step', 'effects', 'when', 'held-out RMSE N·m'],
            [[s.action, ', '.join(s.effects), s.when, _change(s.before, s.after)]
             for s in steps], left=('effects', 'when', 'held-out RMSE N·m'))
    html += markup.bullets(origin.notes)
    return Section('provenance', 'Provenance', html)


def _change(before: Mapping[str, float], after: Mapping[str, float]) -> str:
    parts = [f'{name} {before[name]:.3g} → {after[name]:.3g}' for name in after
             if name in before and abs(after[name] - before[name]) > 0.02 * before[name]]
    return ', '.join(parts) or '–'
