"""Escaping of text from files: names in a bag must not control the terminal."""

from __future__ import annotations

from collections.abc import Sequence
import unicodedata

_UNSAFE = {'Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp'}


def printable(text: object) -> str:
    r"""
    Return `text` on one line, without characters that control a terminal.

    Line breaks and tabs become spaces. Other control characters, escapes, marks of the writing
    direction, and lone surrogates become their code point, as in `\x1b`.
    """
    line = ' '.join(str(text).split())
    return ''.join(_escaped(character) for character in line)


def _escaped(character: str) -> str:
    if unicodedata.category(character) not in _UNSAFE:
        return character
    code = ord(character)
    return f'\\x{code:02x}' if code < 0x100 else f'\\u{code:04x}'


def counted(number: int, thing: str) -> str:
    """Return a number with a singular or plural noun, as in `1 sample` and `2 samples`."""
    return f'{number} {thing if number == 1 else thing + "s"}'


def shown_names(names: Sequence[str], limit: int = 12) -> str:
    """Return the first `limit` names in one line, and the number of further ones."""
    if not names:
        return 'none'
    more = f' and {len(names) - limit} more' if len(names) > limit else ''
    return ', '.join(names[:limit]) + more
