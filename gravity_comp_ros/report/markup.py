"""HTML from plain text and numbers, which is escaped, and the frame of a self-contained page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
import secrets

from gravity_comp_ros.printable import printable
from gravity_comp_ros.report import css


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


# The page loads nothing. Only scripts with the nonce of the page run, so that a name from a
# recording is never executed. Bokeh compiles its callbacks, which requires 'unsafe-eval'.
_POLICY = """default-src 'none'; base-uri 'none'; form-action 'none';
 script-src 'nonce-{nonce}' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:;
 font-src data:"""


# Shown by a browser without scripts where a page has plots.
NO_PLOTS = 'The plots require JavaScript, which is disabled in this browser. Tables and numbers ' \
           'are shown.'


def html_page(title: str, body: str, scripts: Sequence[str] = (), no_script: str = '',
              style: str = '', policy: str = '') -> str:
    """
    Return a page of safe HTML; it requires no network and no other file.

    :param no_script: shown by a browser without scripts.
    :param style: rules in addition to those of a report.
    :param policy: permissions in addition to those of a report.
    """
    nonce = secrets.token_urlsafe(16)
    run = '\n'.join(f'<script nonce="{nonce}">{script}</script>'
                    for script in [css.PREFER_DARK, *scripts])
    without = f'<noscript>{paragraph(no_script)}</noscript>' if no_script else ''
    return (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="'
            f'{_POLICY.format(nonce=nonce)}{policy}">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f'<link rel="icon" href="data:,">\n'
            f'<title>{text(title)}</title>\n<style>{css.REPORT}{style}</style>\n{run}\n'
            f'</head><body><main>{without}{body}</main></body></html>\n')
