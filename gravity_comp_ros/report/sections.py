"""All sections of a report by short name, in their order on the page."""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.section import JointSelector, Section
from gravity_comp_ros.report.table import Table
from gravity_comp_ros.report.views import (
    arm, effects, equations, joints, pairs, provenance, quality, residuals, spectrum, summary,
    time)

# Builds a section; None if it has no content.
Maker = Callable[[Contents, Table, JointSelector], Section | None]
SECTIONS: dict[str, Maker] = {
    'Summary': lambda contents, table, selector: summary.section(contents, table),
    'Errors': lambda contents, table, selector: joints.section(contents),
    'Over time': time.section,
    'Arm': lambda contents, table, selector: arm.section(contents, table),
    'Residual': residuals.section,
    'Pairs': pairs.section,
    'Spectrum': lambda contents, table, selector: spectrum.section(contents, selector),
    'Effects': lambda contents, table, selector: effects.section(contents, table),
    'Model': lambda contents, table, selector: equations.section(contents, selector),
    'Data': lambda contents, table, selector: quality.section(contents),
    'Provenance': lambda contents, table, selector: provenance.section(contents)}
