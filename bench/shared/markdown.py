"""Tables in Markdown."""

from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table from the titles of its columns and the cells of its rows."""
    first, *others = (f'| {" | ".join(map(str, cells))} |' for cells in (head, *rows))
    return '\n'.join([first, f'|{"---|" * len(head)}', *others])
