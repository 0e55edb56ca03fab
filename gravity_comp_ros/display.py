"""Display of results: as text in a terminal, as HTML in a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
import math
import re

from gravity_comp_ros.printable import printable

_CELL = 'text-align:left'
_NUMBER = 'text-align:right;font-variant-numeric:tabular-nums'


@dataclass(frozen=True)
class TextTable:
    """A table of text: `columns` are headings, the first `left` columns are left-aligned."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: int = 1

    def __str__(self) -> str:
        cells = [tuple(printable(cell) for cell in row) for row in (self.columns, *self.rows)]
        widths = [max(len(row[k]) for row in cells) for k in range(len(self.columns))]
        lines = ['  '.join(cell.ljust(width) if k < self.left else cell.rjust(width)
                           for k, (cell, width) in enumerate(zip(row, widths))).rstrip()
                 for row in cells]
        return '\n'.join([lines[0], '  '.join('-' * width for width in widths), *lines[1:]])

    def html(self) -> str:
        """Return the table as HTML, with the text of the cells escaped."""
        def row(cells: Sequence[str], tag: str) -> str:
            return '<tr>' + ''.join(
                f'<{tag} style="{_CELL if k < self.left else _NUMBER}">'
                f'{escape(printable(cell))}</{tag}>' for k, cell in enumerate(cells)) + '</tr>'
        return (f'<table><thead>{row(self.columns, "th")}</thead><tbody>'
                + ''.join(row(cells, 'td') for cells in self.rows) + '</tbody></table>')


class Displayable(ABC):
    """A result with a line for `repr`, and sentences and tables for `print` and notebooks."""

    @abstractmethod
    def summary(self) -> str:
        """Return a description in one line."""

    @abstractmethod
    def details(self) -> Iterable[str | TextTable]:
        """Return the sentences and tables that follow the summary."""

    def __repr__(self) -> str:
        return f'<{type(self).__name__}: {printable(self.summary())}>'

    def __str__(self) -> str:
        parts = [part if isinstance(part, TextTable) else printable(part)
                 for part in (self.summary(), *self.details())]
        return '\n'.join(str(part) for part in parts)

    def _repr_html_(self) -> str:
        first, *parts = (self.summary(), *self.details())
        return f'<p><b>{escape(printable(str(first)))}</b></p>' + ''.join(
            part.html() if isinstance(part, TextTable) else f'<p>{escape(printable(part))}</p>'
            for part in parts)


def percent(share: float | None) -> str:
    """Return a share with three digits, 9.63 % or 18.2 %; a dash for None or NaN."""
    if share is None or not math.isfinite(share):
        return '–'
    value = 100.0 * share
    return f'{value:.{0 if value >= 99.5 else 1 if value >= 9.95 else 2}f} %'


def change(before: float, after: float) -> str:
    """Return the relative change of an error in per cent, a dash if it was 0 before."""
    return f'{100 * (after / before - 1):+.0f} %' if before > 0.0 else '–'


def shortened(equation: str, terms: int) -> str:
    """Return the first `terms` terms of an equation, and the number of further ones."""
    parts = re.split(r'(?= [+-] )', equation)
    if len(parts) <= terms:
        return equation
    return ''.join(parts[:terms]) + f' … {len(parts) - terms} more'
