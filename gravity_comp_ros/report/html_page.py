"""The frame of a self-contained page: head, styles, scripts, and what it may load."""

from __future__ import annotations

import secrets

from gravity_comp_ros.report import css, markup

# The page loads nothing. Only scripts with the nonce of the page run, so that a name from a
# recording is never executed. Bokeh compiles its callbacks, which requires 'unsafe-eval'.
_POLICY = """default-src 'none'; base-uri 'none'; form-action 'none';
 script-src 'nonce-{nonce}' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:;
 font-src data:"""


# Shown by a browser without scripts where a page has plots.
NO_PLOTS = 'The plots require JavaScript, which is disabled in this browser. Tables and numbers ' \
           'are shown.'


def message_html(title: str, message: str) -> str:
    """Return a page with an error message."""
    return html_page(title, f'<h1 id="verdict">{markup.text(message)}</h1>', [])


def html_page(title: str, body: str, scripts: list[str], no_script: str = '') -> str:
    """
    Return a page of safe HTML; it requires no network and no other file.

    :param no_script: shown by a browser without scripts.
    """
    nonce = secrets.token_urlsafe(16)
    run = '\n'.join(f'<script nonce="{nonce}">{script}</script>'
                    for script in [css.PREFER_DARK, *scripts])
    without = f'<noscript>{markup.paragraph(no_script)}</noscript>' if no_script else ''
    return (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="'
            f'{_POLICY.format(nonce=nonce)}">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f'<link rel="icon" href="data:,">\n'
            f'<title>{markup.text(title)}</title>\n<style>{css.REPORT}</style>\n{run}\n'
            f'</head><body><main>{without}{body}</main></body></html>\n')
