"""`--html FILE`: report of a verb as one HTML file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.evaluation.compare import Comparison
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.recordings.bag import ReadReport
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.markup import html_page, text
from rich.text import Text


def write_lines(path: Path, headline: str, lines: Sequence[terminal.Line]) -> None:
    """
    Write the lines of an answer below a headline, atomically.

    :raises GravityCompError: if the page cannot be written.
    """
    body = ''.join(line.html() if isinstance(line, TextTable) else
                   markup.command(line.plain.strip()) if isinstance(line, Text) else
                   markup.paragraph(line) for line in lines if line != '')
    page = html_page(f'gravity_comp: {path.stem}',
                     f'<h1 id="verdict">{text(headline)}</h1>{body}', [markup.COPY])
    write_atomically(path, page.encode(), error=GravityCompError)


def check_libraries(args: argparse.Namespace) -> None:
    """Import what draws a report, if any, so that without it a verb does not compute in vain."""
    if args.html is not None:
        import gravity_comp_ros.report.page  # noqa: F401


def write_report(args: argparse.Namespace, model: GravityModel, samples: JointSamples,
                 comparison: Comparison, compared: str, reports: tuple[ReadReport, ...],
                 notes: tuple[str, ...] = (), **more: Any) -> None:
    """
    Write the report, atomically; the parameters are fields of `report.contents.Contents`.

    :param samples: all samples of the recordings.
    :raises GravityCompError: if it cannot be written.
    """
    from gravity_comp_ros.report.views.arm import find_arm
    from gravity_comp_ros.report.contents import Contents
    from gravity_comp_ros.report.page import report_html
    page = report_html(Contents(
        samples.joints(model.joints), model, comparison, compared, reports, args.command,
        model_file=args.model.name if args.model else None, notes=notes,
        arm=find_arm(args.bags, model.joints, args.urdf), **more))
    write_atomically(args.html, page.encode(), error=GravityCompError)
