"""The server of the web view: a page, a plotting library and data, on this host only."""
import json
import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

from dragon_ros.commands.view.data import ViewData
from dragon_ros.commands.view.page import WEB
from dragon_ros.core.errors import DragonError, MissingError

HOST = '127.0.0.1'
_PAGES = {'/': ('index.html', 'text/html; charset=utf-8'), '/view.js': ('view.js', 'text/javascript; charset=utf-8'),
          '/view.css': ('view.css', 'text/css; charset=utf-8'),
          '/plotly.js': ('plotly-basic.min.js', 'text/javascript; charset=utf-8'),
          '/icon.svg': ('icon.svg', 'image/svg+xml')}
_JSON, _BINARY = 'application/json', 'application/octet-stream'
# The page may only use what this server sends; plotly.js writes styles into it.
_POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; form-action 'none'"


class ViewServer(ThreadingHTTPServer):
    """Serves one run; ``port`` 0 takes any free one. Raises MissingError where the port is taken."""

    daemon_threads = True

    def __init__(self, data: ViewData, port: int = 0) -> None:
        """Bind to this host."""
        self.data = data
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, 'strerror', None) or error
            raise MissingError(f'--port {port}: cannot be used: {reason}; leave it out to take any free one') from None

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a page that was closed during its request."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]

    @property
    def url(self) -> str:
        """The address of the page."""
        return f'http://{HOST}:{self.server_address[1]}/'


class _Handler(BaseHTTPRequestHandler):
    """Answers GET."""

    server: ViewServer
    protocol_version = 'HTTP/1.1'

    def do_GET(self) -> None:
        """Answer, with an error as text where that fails."""
        host = urlsplit(f'//{self.headers.get("Host", "")}').hostname
        if host not in (HOST, 'localhost'):     # a foreign page that gave this host a name of its own
            self.send_error(HTTPStatus.FORBIDDEN, 'this page is for 127.0.0.1 and localhost')
            return
        try:
            found = self._found(urlsplit(self.path).path)
        except DragonError as error:
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR, ' '.join(str(error).split()))
            return
        if found is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            self._send(*found)

    def _found(self, path: str) -> tuple[bytes, str] | None:
        data = self.server.data
        if path in _PAGES:
            name, kind = _PAGES[path]
            return (WEB / name).read_bytes(), kind
        if path in ('/run.json', '/clearance.json'):
            values = data.run if path == '/run.json' else data.clearance()
            return json.dumps(values, allow_nan=False).encode(), _JSON
        folder, _, name = path.lstrip('/').partition('/')
        if folder == 'frames' and name == 'contact':
            return data.contact_frame(), _BINARY
        if folder == 'frames' and name.isdecimal() and int(name) < data.chunks:
            return data.frames(int(name)), _BINARY
        return None

    def _send(self, body: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header('Content-Type', kind)
        self.send_header('Content-Length', str(len(body)))
        self.send_header('Content-Security-Policy', _POLICY)
        self.send_header('Cache-Control', 'no-store')
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *args: object) -> None:
        """Log nothing: the terminal is for messages to the user."""
