"""
Access control of the server: allowed hosts, refused paths and response headers.

After DNS rebinding, a browser sends an attacker's host name, which resolves to this machine, in
the Host header. All requests whose Host is not this machine are refused: page, websocket and
scripts.
"""

from __future__ import annotations

from ipaddress import ip_address
import socket
from typing import Any

from bokeh.server.connection import ServerConnection
from bokeh.server.tornado import BokehTornado
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import ErrorHandler, OutputTransform

LOCAL = ('localhost', '127.0.0.1', '[::1]')
# Paths that the workbench does not use and that a page of another site could include.
_REFUSED = ('/autoload.js', '/metadata', '/static/js/bokeh-mathjax')
_HEADERS = {'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'DENY',
            'Referrer-Policy': 'no-referrer', 'Cross-Origin-Resource-Policy': 'same-origin',
            'Cross-Origin-Opener-Policy': 'same-origin',
            'Content-Security-Policy': "frame-ancestors 'none'"}


def allowed_hosts(address: str, port: int) -> tuple[str, ...]:
    """Return the allowed hosts, with port, of a server on this address."""
    own = [socket.gethostname(), socket.getfqdn()] if _is_everywhere(address) else [
        f'[{address}]' if ':' in address else address]
    names = [*LOCAL, *own]
    return tuple(dict.fromkeys(f'{name.lower()}:{port}' for name in names))


def is_allowed(host: str, hosts: tuple[str, ...], address: str) -> bool:
    """Return whether a Host header names this server; an IP address cannot be rebound."""
    if host.lower() in hosts:
        return True
    if not hosts or not _is_everywhere(address):
        return False
    name, _, port = host.rpartition(':')
    try:
        ip_address(name.strip('[]'))
    except ValueError:
        return False
    return port == hosts[0].rpartition(':')[2]


def _is_everywhere(address: str) -> bool:
    try:
        return ip_address(address).is_unspecified
    except ValueError:
        return not address


class GuardedApplication(BokehTornado):
    """Bokeh's server application, restricted to requests for this machine."""

    def __init__(self, applications: Any, hosts: tuple[str, ...], address: str,
                 **more: Any) -> None:
        self._hosts, self._address = hosts, address
        super().__init__(applications, **more)
        self.add_transform(_Headers)

    def find_handler(self, request: HTTPServerRequest, **more: Any) -> Any:
        """Return the handler of a request; a refusal for other hosts."""
        hosts = request.headers.get_list('Host')
        if len(hosts) != 1 or not is_allowed(hosts[0], self._hosts, self._address):
            return self._refusal(request, 421)
        if request.path.startswith(_REFUSED) or request.method not in ('GET', 'HEAD', 'PUT'):
            return self._refusal(request, 404)
        return super().find_handler(request, **more)

    def client_lost(self, connection: ServerConnection) -> None:
        """
        Detach the session of a closed connection, and drop its remaining messages.

        Bokeh does so after a failed ping too. When the socket of that connection closes
        afterwards, or messages that arrived before the end are handled, Bokeh would require the
        session again and log a failed assertion.
        """
        super().client_lost(connection)
        connection._socket.connection = None
        connection._socket.on_message = _drop

    def _refusal(self, request: HTTPServerRequest, status: int) -> Any:
        return self.get_handler_delegate(request, ErrorHandler, {'status_code': status})


async def _drop(message: str | bytes) -> None:
    """Handle a message of a closed connection."""


class _Headers(OutputTransform):
    """Adds the headers that keep other sites from framing or including a page."""

    def transform_first_chunk(self, status_code: int, headers: HTTPHeaders, chunk: bytes,
                              finishing: bool) -> tuple[int, HTTPHeaders, bytes]:
        """Return the response with the headers."""
        for name, value in _HEADERS.items():
            headers[name] = value
        return status_code, headers, chunk
