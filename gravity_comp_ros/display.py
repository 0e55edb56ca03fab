"""Display of results: as text in a terminal, as HTML in a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
import math
import re

from gravity_comp_ros.printable import printable

# A cell of a column of numbers, which is right-aligned.
_NUMBER = re.compile(r'[-+±–−…→∞\d.,e%\s]*')


@dataclass(frozen=True)
class TextTable:
    """A table of plain text for a terminal, a notebook and a page; `columns` are headings."""

    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    title: str = ''

    def cells(self) -> list[list[str]]:
        """Return the printable cells of the headings and of all rows."""
        return [[printable(cell) for cell in row] for row in (self.columns, *self.rows)]

    def has_numbers(self) -> list[bool]:
        """Return for each column whether it has numbers alone; the first one has names."""
        _, *rows = self.cells()
        return [k > 0 and all(_NUMBER.fullmatch(row[k]) for row in rows)
                for k in range(len(self.columns))]

    def __str__(self) -> str:
        cells, numbers = self.cells(), self.has_numbers()
        widths = [max(map(len, column)) for column in zip(*cells)]
        first, *lines = ['  '.join(
            cell.rjust(width) if is_number else cell.ljust(width)
            for cell, width, is_number in zip(row, widths, numbers)).rstrip() for row in cells]
        return '\n'.join([first, '  '.join('-' * width for width in widths), *lines])

    def html(self, strong: int | None = None, bars: Sequence[float] = ()) -> str:
        """
        Return the table as HTML, with the text of the cells escaped.

        :param strong: index of an emphasised row, if any.
        :param bars: length of a bar in the second cell of each row, 0 to 1, if any.
        """
        numbers = ['style="text-align:right" class="number"' if is_number else
                   'style="text-align:left"' for is_number in self.has_numbers()]

        def row(cells: Sequence[str], scope: str, tag: str, kind: str = '') -> str:
            tags = [f'th scope="{scope}"', *[tag] * (len(cells) - 1)]
            return f'<tr{kind}>' + ''.join(
                f'<{start} {number}>{escape(cell)}</{start[:2]}>'
                for cell, start, number in zip(cells, tags, numbers)) + '</tr>'

        head, *rows = self.cells()
        kinds = [' class="strong"' * (k == strong) for k in range(len(rows))]
        kinds = [f'{kind} style="--bar:{bar:.0%}"' for kind, bar in zip(kinds, bars)] or kinds
        body = ''.join(row(cells, 'row', 'td', kind) for cells, kind in zip(rows, kinds))
        return ('<div class="wide"><table><thead>' + row(head, 'col', 'th scope="col"')
                + f'</thead><tbody>{body}</tbody></table></div>')


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
