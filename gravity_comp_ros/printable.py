"""Text from files made safe to show: names in a bag are data, never terminal commands."""

from __future__ import annotations

from collections.abc import Sequence
import unicodedata

_UNSAFE = {'Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp'}


def printable(text: object) -> str:
    r"""
    Return `text` on one line, with nothing in it that a terminal would obey.

    Line breaks and tabs become spaces. Other control characters, escapes, marks that turn the
    direction of writing, and lone surrogates become their code point, as in `\x1b`.
    """
    line = ' '.join(str(text).split())
    return ''.join(_shown(character) for character in line)


def _shown(character: str) -> str:
    if unicodedata.category(character) not in _UNSAFE:
        return character
    code = ord(character)
    return f'\\x{code:02x}' if code < 0x100 else f'\\u{code:04x}'


def counted(number: int, thing: str) -> str:
    """Return a number and what is counted, as in `1 sample` and `2 samples`."""
    return f'{number} {thing if number == 1 else thing + "s"}'


def shown_names(names: Sequence[str], most: int = 12) -> str:
    """Return names in one line, and how many there are after the first `most`."""
    more = f' and {len(names) - most} more' if len(names) > most else ''
    return ', '.join(names[:most]) + more
