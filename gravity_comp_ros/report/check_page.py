"""The faults of a robot description as one HTML file, with a drawing of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.links import DescribedArm
from gravity_comp_ros.description_check.check import DescriptionCheck
from gravity_comp_ros.description_check.sentences import error_rows, Finding
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.printable import counted, printable
from gravity_comp_ros.report import markup
import numpy as np

# View of the drawing: azimuth and elevation in rad.
_AZIMUTH, _ELEVATION = 0.6, 0.3
# Size of the drawing in its own units, and its margin.
_SIZE, _MARGIN = 560.0, 70.0
# Length of the last link, which a description of joints does not give, and half the length of a
# drawn axis, as shares of the drawing.
_TOOL, _AXIS = 0.05, 0.055
# Width of a letter of a label.
_LETTER = 8.5


def check_html(title: str, check: DescriptionCheck, faults: Sequence[Finding],
               unchecked: Sequence[str], arm: DescribedArm, pose: FloatArray) -> str:
    """
    Return the page.

    :param title: name of the description.
    :param pose: angles (N,) in rad of the drawing, a recorded pose.
    """
    headline = f'{title}: {counted(len(faults), "fault") if faults else "no fault"} found'
    places = [_joints_of(fault, arm) for fault in faults]
    items = ''.join(
        f'<h2>{number}. {markup.text(fault.sentence)}</h2>'
        + markup.bullets(f'or, as probable: {other}' for other in fault.alternatives)
        + markup.command(fault.correction) for number, fault in enumerate(faults, start=1))
    table = markup.table(('joint', 'torque RMS, N·m', 'RMSE as described, N·m',
                          'RMSE corrected, N·m'), error_rows(check))
    body = (f'<h1 id="verdict">{markup.text(headline)}</h1>{items}'
            f'{_drawing(arm.geometry, pose, places)}'
            f'{markup.paragraph(_LEAD, "quiet")}'
            f'<h2>Error by joint</h2>{table}{markup.bullets(unchecked)}')
    return markup.html_page(f'gravity_comp check: {title}', body, [markup.COPY])


_LEAD = ('The arm as described, in a recorded pose. A line through a joint is its axis. Numbers '
         'are those of the faults.')


def _joints_of(fault: Finding, arm: DescribedArm) -> set[int]:
    """Return the joints of a fault by number; -1 is the base."""
    joints = arm.geometry.joints
    return {joints.index(subject) if subject in joints
            else arm.places[subject].joint if subject in arm.places else -1
            for subject in fault.subjects}


def _drawing(geometry: Geometry, pose: FloatArray, faults: Sequence[set[int]]) -> str:
    """Return the arm as an SVG; `faults` are the joints of each fault."""
    places, axes = _posed(geometry, pose)
    flat = _project(places)
    scale = _SIZE / max(float(np.ptp(flat, axis=0).max()), 1e-6)
    flat = _MARGIN + scale * (flat - flat.min(axis=0))
    marked = {joint: [k + 1 for k, joints in enumerate(faults) if joint in joints]
              for joint in {joint for joints in faults for joint in joints}}
    lines = [_line(flat[k], flat[k + 1], 'link') for k in range(len(flat) - 1)]
    labels = []
    for k, name in enumerate(('base', *geometry.joints)):
        at, kind = flat[k], 'fault' if k - 1 in marked else 'sound'
        if k:
            step = _AXIS * _SIZE * _project(axes[k - 1])
            lines.append(_line(at - step, at + step, f'axis {kind}'))
        lines.append(f'<circle class="{kind}" cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="9"/>')
        numbers = ', '.join(map(str, marked.get(k - 1, ())))
        text = printable(f'{numbers}: {name}' if numbers else name)
        labels.append(f'<text class="{kind}" x="{at[0] + 16:.1f}" y="{at[1] + 5:.1f}">'
                      f'{escape(text)}</text>')
    longest = max(len(name) for name in geometry.joints)
    width, height = flat.max(axis=0) + _MARGIN + [_LETTER * longest, 0.0]
    return (f'<svg class="arm" viewBox="0 0 {width:.0f} {height:.0f}" style="max-width: '
            f'{width:.0f}px" role="img" aria-label="the arm with its joints">{"".join(lines)}'
            f'{"".join(labels)}</svg>')


def _posed(geometry: Geometry, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the places (N + 2, 3) in m of base, joints and tool, and the axes (N, 3)."""
    rotated = ForwardKinematics(geometry.rotations, pose[None]).rotated[..., 0]
    steps = np.einsum('nac,na->nc', np.concatenate([np.eye(3)[None], rotated[:-1]]),
                      geometry.origins)
    places, axes = np.vstack([np.zeros(3), steps.cumsum(axis=0)]), rotated[:, 2]
    tool = places[-1] + _TOOL * max(float(np.ptp(places, axis=0).max()), 1e-3) * axes[-1]
    return np.vstack([places, tool]), axes


def _project(points: FloatArray) -> FloatArray:
    """Return points (..., 3) in m in the plane of the view (..., 2), y downwards."""
    ca, sa, ce, se = (f(angle) for angle in (_AZIMUTH, _ELEVATION) for f in (np.cos, np.sin))
    return points @ np.array([[-sa, se * ca], [ca, se * sa], [0.0, -ce]])


def _line(a: FloatArray, b: FloatArray, kind: str) -> str:
    return (f'<line class="{kind}" x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" '
            f'y2="{b[1]:.1f}"/>')
