"""Quality of the recordings: rates, dropped messages, ranges and speeds."""

from __future__ import annotations

from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section


def section(contents: Contents) -> Section:
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
