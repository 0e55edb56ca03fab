"""All parts of a report, in the order of a reader's questions."""

from __future__ import annotations

from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.report.views import (
    answer, arm, effects, equations, joints, pairs, provenance, quality, residuals, spectrum, time)


def all_sections(contents: Contents, style: Style) -> list[Section]:
    """Return every part; their plots share one table, so that selections are common."""
    table = Table(contents)
    table.embed_fine_lines()
    found = [answer.section(contents, table, style), joints.section(contents),
             time.section(contents, table, style), arm.section(contents, table, style),
             residuals.section(contents, table, style), pairs.section(contents, table, style),
             spectrum.section(contents, style), effects.section(contents, table, style),
             equations.section(contents, style), quality.section(contents),
             provenance.section(contents)]
    return [section for section in found if section is not None]
