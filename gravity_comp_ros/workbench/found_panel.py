"""What is missing, and a button for each effect that can be added."""

from __future__ import annotations

from collections.abc import Callable

from bokeh.layouts import row
from bokeh.models import UIElement
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.views.effects import coefficients, label, structure
from gravity_comp_ros.workbench import widgets
from gravity_comp_ros.workbench.open_session import OpenSession

_MOST_ROWS = 8


def parts(one: OpenSession, add: Callable[[str], None]) -> list[UIElement]:
    """Return the panel of a session."""
    session = one.session
    stage = session.stage
    shown: list[UIElement] = [widgets.html('<h2>What is missing</h2>')]
    if stage is None:
        shown.append(_quiet('No model yet.'))
    elif session.diagnosis is None:
        shown.append(_quiet('Not looked for yet.' if one.trouble else
                            'Being looked for; the views below are ready.'))
    else:
        shown += _findings(one, add)
        shown.append(widgets.html(structure(session.diagnosis)))
    if stage is not None and stage.model.applied.effects:
        held = ', '.join(e.target for e in stage.model.applied.effects)
        shown.append(widgets.html(f'<p id="held">The model has {markup.text(held)}.</p>'))
    return shown


def _findings(one: OpenSession, add: Callable[[str], None]) -> list[UIElement]:
    found = one.session.findings()
    if not found and one.session.diagnosis is not None:
        return [widgets.html(markup.paragraph(wording.verdict(one.session.diagnosis)))]
    shown: list[UIElement] = []
    adding = one.worker.busy and hasattr(one.worker.running, 'effects')
    for number, (finding, target) in enumerate(found[:_MOST_ROWS]):
        entry: list[UIElement] = [widgets.html(_told(number, finding))]
        if target:
            entry.append(widgets.button(f'Add {target}', _adder(add, target), 'primary',
                                        width=190, disabled=adding, name=f'add-{number}'))
        shown.append(row(*entry, sizing_mode='stretch_width'))
    more = len(found) - _MOST_ROWS
    if more > 0:
        shown.append(widgets.html(markup.paragraph(f'{more} more in the view Effects.')))
    return shown


def _told(number: int, finding: Finding) -> str:
    change = (f'{wording.percent(finding.nrmse_before)} → '
              f'{wording.percent(finding.nrmse_after)} of the range')
    rivals = f'; or rather {", ".join(finding.rivals)}' if finding.rivals else ''
    return (f'<p><b>{number + 1}. {markup.text(label(finding))}</b> on '
            f'{markup.text(finding.joint or "whole arm")}, {markup.text(finding.verdict)}<br>'
            f'<span class="quiet">{markup.text(coefficients(finding))}; held-out error '
            f'{markup.text(change + rivals)}</span></p>')


def _adder(add: Callable[[str], None], target: str) -> Callable[[], None]:
    return lambda: add(target)


def _quiet(words: str) -> UIElement:
    return widgets.html(markup.paragraph(words, 'quiet'))
