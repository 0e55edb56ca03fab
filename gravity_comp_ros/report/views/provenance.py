"""Provenance of a report: command, versions, files and model history."""

from __future__ import annotations

from collections.abc import Mapping

from gravity_comp_ros import __version__
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
import numpy as np


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
