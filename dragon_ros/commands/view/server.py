"""The server of the web view: a page, a plotting library and data, on this host only.

With ``--try``, the data are those of the variant that the query of the address describes. Long work ends early at a
deadline, or when the page no longer waits for it, for instance because the user moved a slider.
"""
import json
import re
import select
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedReader, RawIOBase
from threading import BoundedSemaphore, Lock
from typing import Any
from urllib.parse import urlsplit

from dragon_ros.commands.view.data import ViewData
from dragon_ros.commands.view.page import WEB
from dragon_ros.commands.view.variants import QUESTIONS, Variants
from dragon_ros.core.errors import DragonError, InputError, MissingError, ModelEnd
from dragon_ros.core.limits import VIEW_ANSWER_S, VIEW_CONNECTIONS, VIEW_IDLE_S
from dragon_ros.pictures.sources import Check

HOST = '127.0.0.1'
_PAGES = {'/': ('index.html', 'text/html; charset=utf-8'), '/view.js': ('view.js', 'text/javascript; charset=utf-8'),
          '/benches.js': ('benches.js', 'text/javascript; charset=utf-8'),
          '/webgl.js': ('webgl.js', 'text/javascript; charset=utf-8'),
          '/words.js': ('words.js', 'text/javascript; charset=utf-8'),
          '/view.css': ('view.css', 'text/css; charset=utf-8'),
          '/plotly.js': ('plotly-basic.min.js', 'text/javascript; charset=utf-8'),
          '/icon.svg': ('icon.svg', 'image/svg+xml')}
_TRY_PATH = '/try.js'
_ANSWERS: dict[str, Callable[[ViewData, Check], Any]] = {
    '/run.json': ViewData.run, '/contact.json': ViewData.contact,
    '/clearance.json': ViewData.clearance}
_ROOM_S = 1.0       # longest wait (s) for a connection to end after it was closed to make room for another
_CHUNK = re.compile('[0-9]{1,9}')
_JSON, _BINARY, _TEXT = 'application/json', 'application/octet-stream', 'text/plain; charset=utf-8'
# The page may use only resources of this server; plotly.js adds inline styles.
_POLICY = ("default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; form-action 'none'; "
           "frame-ancestors 'none'; base-uri 'none'; object-src 'none'")
_HEADERS = {'Content-Security-Policy': _POLICY, 'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'DENY',
            'Referrer-Policy': 'no-referrer', 'Cache-Control': 'no-store'}


class _GoneError(Exception):
    """The client no longer waits for the answer."""


class ViewServer(ThreadingHTTPServer):
    """A server for one run or for a scene's variants; if ``port`` is 0, any free port is used.

    Raises MissingError if the port is in use.
    """

    daemon_threads = True
    request_queue_size = VIEW_CONNECTIONS       # beyond that of the standard library, 5, a client tries again after 1 s

    def __init__(self, shown: ViewData | Variants, port: int = 0, lang: str | None = None) -> None:
        """Bind to this host; without ``lang``, the page uses the browser's language."""
        self.shown, self.lang = shown, lang
        self._room = BoundedSemaphore(VIEW_CONNECTIONS)
        self._lock = Lock()
        # Connections that wait for their client, and others, whose answers are being computed; oldest first.
        self._waiting, self._working = dict[socket.socket, None](), dict[socket.socket, None]()
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, 'strerror', None) or error
            raise MissingError(f'--port {port}: cannot be used: {reason}; omit it to use any free port') from None

    def verify_request(self, request: object, client_address: object) -> bool:
        """Accept a connection. If there are too many, close the one that has waited longest for its client.

        If none waits for its client, close the one whose answer has been computed for the longest time.
        """
        return self._room.acquire(blocking=False) or (self._close_oldest() and self._room.acquire(timeout=_ROOM_S))

    def _close_oldest(self) -> bool:
        with self._lock:
            some = self._waiting or self._working
            oldest = next(iter(some), None)
            if oldest is not None:
                del some[oldest]
        if oldest is not None:
            with suppress(OSError):     # the connection's thread has already ended
                oldest.shutdown(socket.SHUT_RDWR)
        return oldest is not None

    def wait_for(self, connection: socket.socket) -> None:
        """Note that a connection waits for its client to send or to read."""
        self._note(connection, self._waiting)

    def work_for(self, connection: socket.socket) -> None:
        """Note that an answer is computed for a connection."""
        self._note(connection, self._working)

    def _note(self, connection: socket.socket, kind: 'dict[socket.socket, None] | None') -> None:
        with self._lock:
            self._waiting.pop(connection, None)
            self._working.pop(connection, None)
            if kind is not None:
                kind[connection] = None

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, then free its slot."""
        self.wait_for(request)
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._note(request, None)
            self._room.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a page that closes during its request or does not read its answer."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)  # type: ignore[arg-type]

    @property
    def url(self) -> str:
        """The address of the page."""
        return f'http://{HOST}:{self.server_address[1]}/'


class _Request(RawIOBase):
    """The input of a connection, with a deadline for each request, even for a request that arrives slowly."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection, self.deadline_s = connection, 0.0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Receive bytes. Raises TimeoutError after the deadline."""
        left_s = self.deadline_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError
        self._connection.settimeout(left_s)
        return self._connection.recv_into(buffer)


class _Handler(BaseHTTPRequestHandler):
    """A handler of GET requests."""

    server: ViewServer
    protocol_version = 'HTTP/1.1'
    timeout = VIEW_IDLE_S

    def setup(self) -> None:
        """Replace the connection's input with one that has a deadline."""
        super().setup()
        self.rfile.close()
        self._incoming = _Request(self.connection)
        self.rfile = BufferedReader(self._incoming)

    def handle_one_request(self) -> None:
        """Wait for a request and answer it."""
        self._incoming.deadline_s = time.monotonic() + VIEW_IDLE_S
        self.server.wait_for(self.connection)
        super().handle_one_request()

    def do_GET(self) -> None:
        """Answer the request; if that fails, answer with the error as text."""
        self.connection.settimeout(VIEW_IDLE_S)
        self.server.work_for(self.connection)
        status, body, kind = self._answer()
        self.server.wait_for(self.connection)
        self._send(status, body, kind)

    def _answer(self) -> tuple[HTTPStatus, bytes, str]:
        """Return the answer and its type; if there is none, the reason as text."""
        if not self._is_for_us():
            return HTTPStatus.FORBIDDEN, b'this page is available only to itself, at 127.0.0.1 and localhost', _TEXT
        path, _, query = self.path.partition('?')
        try:
            found = self._found(path, query, self._check(time.monotonic() + VIEW_ANSWER_S))
        except _GoneError:
            self.close_connection = True
            return HTTPStatus.REQUEST_TIMEOUT, b'', _TEXT
        except DragonError as error:
            wrong = isinstance(error, (InputError, ModelEnd))
            status = HTTPStatus.BAD_REQUEST if wrong else HTTPStatus.INTERNAL_SERVER_ERROR
            return status, ' '.join(str(error).split()).encode(errors='replace'), _TEXT
        return (HTTPStatus.NOT_FOUND, b'not found', _TEXT) if found is None else (HTTPStatus.OK, *found)

    def _is_for_us(self) -> bool:
        """Return whether a request is that of the page itself or of the address bar.

        A foreign page may use another host name for this host (DNS rebinding), or this one.
        """
        host = self.headers.get('Host', '')
        try:
            named = urlsplit(f'//{host}').hostname in (HOST, 'localhost')
        except ValueError:      # an invalid address, such as [
            return False
        return (named and self.headers.get('Origin', f'http://{host}') == f'http://{host}' and
                self.headers.get('Sec-Fetch-Site', 'none') in ('none', 'same-origin'))

    def _check(self, deadline_s: float) -> Check:
        """Return a check that ends the work on an answer if the page closes the connection or the time is up."""
        def check() -> None:
            if time.monotonic() > deadline_s:
                raise DragonError(f'{self.path[:80]}: takes longer than {VIEW_ANSWER_S:g} s; use the command line')
            with suppress(OSError):
                if select.select([self.connection], [], [], 0)[0] and not self.connection.recv(1, socket.MSG_PEEK):
                    raise _GoneError
        return check

    def _found(self, path: str, query: str, check: Check) -> tuple[bytes, str] | None:
        shown = self.server.shown
        if path in _PAGES:
            return self._page(path), _PAGES[path][1]
        if isinstance(shown, ViewData):
            return _data(shown, path, check)
        if path == _TRY_PATH:
            return (WEB / 'try.js').read_bytes(), _PAGES['/view.js'][1]
        if path == '/form.json':
            return _json(shown.form(query))
        if path == '/scene.yaml':
            return shown.scene_file(query), 'application/yaml'
        folder, _, name = path.lstrip('/').partition('/')
        if folder == 'answers' and name in QUESTIONS:
            return _json(shown.answer(name, query, check))
        return _data(shown.variant(query).data, path, check)

    def _page(self, path: str) -> bytes:
        page = (WEB / _PAGES[path][0]).read_bytes()
        if path == '/' and self.server.lang is not None:
            page = page.replace(b'<html lang="en">', f'<html lang="en" data-lang="{self.server.lang}">'.encode())
        if path == '/' and isinstance(self.server.shown, Variants):
            return page.replace(b'</head>', f'<script src="{_TRY_PATH[1:]}" defer></script>\n</head>'.encode())
        return page

    def _send(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header('Content-Type', kind)
        self.send_header('Content-Length', str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def end_headers(self) -> None:
        """Send the headers of every answer, including errors."""
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, *args: object) -> None:
        """Log nothing; the terminal is reserved for messages to the user."""


def _data(data: ViewData, path: str, check: Check) -> tuple[bytes, str] | None:
    """Return the data of a path and their type, or None if the path does not exist."""
    if path in _ANSWERS:
        return _json(_ANSWERS[path](data, check))
    folder, _, name = path.lstrip('/').partition('/')
    if folder == 'frames' and name == 'contact':
        return data.contact_frame(check), _BINARY
    if folder == 'frames' and _CHUNK.fullmatch(name) and int(name) < data.chunks:
        return data.frames(int(name), check), _BINARY
    return None


def _json(values: Any) -> tuple[bytes, str]:
    return json.dumps(values, allow_nan=False).encode(), _JSON
