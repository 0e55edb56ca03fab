"""HTML from plain text and numbers; escapes all text from files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from gravity_comp_ros.printable import printable


def text(value: object) -> str:
    """Return text as escaped HTML on one line."""
    return escape(printable(value), quote=True)


def units(content: str) -> str:
    """Return a line with superscript powers: kg·m², not kg·m^2."""
    for plain, raised in (('^2', '²'), ('^3', '³')):
        content = content.replace(plain, raised)
    return content


def paragraph(value: object, kind: str = '') -> str:
    """Return a paragraph of plain text."""
    return f'<p class="{kind}">{text(value)}</p>' if kind else f'<p>{text(value)}</p>'


def table(columns: Sequence[str], rows: Iterable[Sequence[object]], left: Sequence[str] = (),
          strong: int | None = None) -> str:
    """
    Return a table of plain text; the first column and those in `left` are text, others numbers.

    :param strong: index of the emphasised row, if any.
    """
    is_text = [k == 0 or column in left for k, column in enumerate(columns)]
    head = ''.join(f'<th scope="col"{_class(t)}>{text(c)}</th>' for c, t in zip(columns, is_text))
    body = ''
    for number, row in enumerate(rows):
        cells = ''.join(_cell(k, value, is_text[k]) for k, value in enumerate(row))
        body += f'<tr class="strong">{cells}</tr>' if number == strong else f'<tr>{cells}</tr>'
    return (f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
            f'<tbody>{body}</tbody></table></div>')


def bullets(lines: Iterable[object]) -> str:
    """Return a list of plain lines; an empty string for no lines."""
    items = ''.join(f'<li>{text(line)}</li>' for line in lines)
    return f'<ul>{items}</ul>' if items else ''


def folded(summary: str, html: str) -> str:
    """Return a collapsed section of HTML."""
    return f'<details><summary>{text(summary)}</summary>{html}</details>'


def command(line: str) -> str:
    """Return a command line with a copy button."""
    content = '\n'.join(text(part) for part in line.splitlines())
    return (f'<div class="command"><pre tabindex="0">{content}</pre>'
            f'<button type="button" class="copy" data-copy="{content}">Copy</button></div>')


def key(colours: Sequence[tuple[str, str]]) -> str:
    """Return a legend of (colour, name) pairs for several plots."""
    entries = ''.join(f'<span><i style="background:{escape(colour, quote=True)}"></i>{text(name)}'
                      '</span>' for colour, name in colours)
    return f'<p class="key">{entries}</p>'


def _class(is_text: bool) -> str:
    return '' if is_text else ' class="number"'


def _cell(place: int, value: object, is_text: bool) -> str:
    if place == 0:
        return f'<th scope="row">{text(value)}</th>'
    return f'<td{_class(is_text)}>{text(value)}</td>'


# Handler of the copy buttons of `command`; the path locates a click inside a shadow root.
COPY = """
document.addEventListener('click', (event) => {
  const button = event.composedPath()[0]
  if (!button.classList || !button.classList.contains('copy')) return
  const done = () => {
    button.textContent = 'Copied'
    setTimeout(() => button.textContent = 'Copy', 2000)
  }
  const by_hand = () => {
    // A page from a file has no clipboard: select the line.
    getSelection().selectAllChildren(button.previousSibling)
    button.textContent = 'Press Ctrl-C'
  }
  if (navigator.clipboard) navigator.clipboard.writeText(button.dataset.copy).then(done, by_hand)
  else by_hand()
})
"""
