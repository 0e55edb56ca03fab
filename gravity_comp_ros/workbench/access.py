"""
Access control of the server: a token in the URL, and response headers.

Every user of this machine can reach the port. The page, its uploads and its list of sessions
require the token, which only the terminal of the workbench shows. The websocket accepts only
session ids that the server has signed and put into a page.
"""

from __future__ import annotations

from hmac import compare_digest
from ipaddress import ip_address
import secrets
from typing import Any

from bokeh.server.tornado import BokehTornado
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform, RequestHandler

ARGUMENT = 'token'
# MathJax would turn formulas in names into links.
_REFUSED = '/static/js/bokeh-mathjax'
_HEADERS = {'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'DENY',
            'Referrer-Policy': 'no-referrer', 'Cross-Origin-Resource-Policy': 'same-origin',
            'Cross-Origin-Opener-Policy': 'same-origin',
            'Content-Security-Policy': "frame-ancestors 'none'"}


def websocket_origins(address: str, port: int) -> list[str]:
    """Return the hosts of pages that may open the websocket of a server on this address."""
    if is_everywhere(address):
        return ['*']
    own = f'[{address}]' if ':' in address else address
    return [f'{name}:{port}' for name in ('localhost', '127.0.0.1', '[::1]', own)]


def is_everywhere(address: str) -> bool:
    """Return whether an address is that of all interfaces of the machine."""
    try:
        return ip_address(address).is_unspecified
    except ValueError:
        return not address


class TokenApplication(BokehTornado):
    """Bokeh's server application, restricted to requests with the token."""

    def __init__(self, applications: Any, token: str, **more: Any) -> None:
        self._token = token
        super().__init__(applications, sign_sessions=True,
                         secret_key=secrets.token_bytes(32), **more)
        self.add_transform(_Headers)

    def find_handler(self, request: HTTPServerRequest, **more: Any) -> Any:
        """Return the handler of a request, or a refusal without the token."""
        if request.path.startswith(_REFUSED) or request.method not in ('GET', 'HEAD', 'PUT'):
            return self._refusal(request, 404, 'there is no such page')
        # Bokeh's scripts are public, and the websocket has its own check.
        is_open = request.path.startswith('/static/') or request.path == '/ws'
        given = b''.join(request.arguments.get(ARGUMENT, []))
        if not is_open and not compare_digest(given, self._token.encode()):
            return self._refusal(request, 403, 'open the address that the terminal of the '
                                 'workbench shows: it contains a token')
        return super().find_handler(request, **more)

    def _refusal(self, request: HTTPServerRequest, status: int, reason: str) -> Any:
        return self.get_handler_delegate(request, _Refusal, {'status': status, 'reason': reason})


class _Refusal(RequestHandler):
    """Refuses a request with a line of text."""

    def initialize(self, status: int, reason: str) -> None:
        """Store status and reason."""
        self._status, self._text = status, reason

    def prepare(self) -> None:
        """Refuse."""
        self.set_status(self._status)
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(self._text + '\n')


class _Headers(OutputTransform):
    """Adds the headers that keep other sites from framing or including a page."""

    def transform_first_chunk(self, status_code: int, headers: HTTPHeaders, chunk: bytes,
                              finishing: bool) -> tuple[int, HTTPHeaders, bytes]:
        """Return the response with the headers."""
        for name, value in _HEADERS.items():
            headers[name] = value
        return status_code, headers, chunk
