"""All sections of a report by short name, in their order on the page."""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import Section
from gravity_comp_ros.report.source import Table
from gravity_comp_ros.report.style import Style
from gravity_comp_ros.report.views import (
    arm, effects, equations, joints, pairs, provenance, quality, residuals, spectrum, summary,
    time)

# Builds a section; None if it has no content.
Maker = Callable[[Contents, Table, Style], Section | None]
SECTIONS: dict[str, Maker] = {
    'Summary': summary.section,
    'Errors': lambda contents, table, style: joints.section(contents),
    'Over time': time.section,
    'Arm': arm.section,
    'Residual': residuals.section,
    'Pairs': pairs.section,
    'Spectrum': lambda contents, table, style: spectrum.section(contents, style),
    'Effects': effects.section,
    'Model': lambda contents, table, style: equations.section(contents, style),
    'Data': lambda contents, table, style: quality.section(contents),
    'Provenance': lambda contents, table, style: provenance.section(contents)}
