"""The server of a live page: it answers a browser on this machine that has the token.

It is the server of Python's standard library: four fixed requests of one user need no framework,
nothing has to be installed, and every check is here to be read. No request names a file.
"""

import base64
import hashlib
import json
import re
import secrets
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer, ThreadingMixIn
from typing import Any

from dockloop.base.errors import DockloopError, UsageError, find_reason
from dockloop.live.bench import SLIDERS, Bench, DroppedError, condense, describe_entries, make_page
from dockloop.live.export import make_command, make_exports
from dockloop.view.page import fill_template, read_web

ADDRESS = "127.0.0.1"
_LARGEST = 100_000  # bytes of a request
_MOST = 1000  # settings of a request
_LONGEST = 2000  # characters of a name or a value
_LAST_PORT = 65535
_PATIENCE = 60.0  # s that a connection may be silent
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address has the token
    "X-Content-Type-Options": "nosniff",
}


class _RequestError(DockloopError):
    """A request that is not answered: its status and why."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class LiveServer(ThreadingMixIn, TCPServer):
    """Serves the page of one scene on this machine only.

    Attributes:
        bench: what computes.
        token: in every address, else nothing is answered.
        page: what a browser shows.
        url: address of the page.
        first_url: leads there once: other users of the machine see the command of a browser.
    """

    daemon_threads = True  # the end of the program waits for no browser
    allow_reuse_address = sys.platform != "win32"  # there it would share the port

    def __init__(self, bench: Bench, port: int = 0) -> None:
        """Compute the first docking and take the port.

        Args:
            bench: what computes.
            port: 0: one that is free.

        Raises:
            UsageError: the scene is bad, or the port is none or taken.
            DockloopError: the first docking failed.
        """
        if not 0 <= port <= _LAST_PORT:
            raise UsageError(f"--port {port}: must be 0 to {_LAST_PORT}")
        self.bench = bench
        self.token, self._key = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self._keys = threading.Lock()
        self.page = self._write_page()
        try:
            super().__init__((ADDRESS, port), _Handler)
        except OSError as error:
            raise UsageError(
                f"--port {port}: cannot be taken ({find_reason(error)}): name another port, or none"
            ) from None
        self.host = f"{ADDRESS}:{self.server_address[1]}"
        self.url = f"http://{self.host}/{self.token}/"
        self.first_url = f"http://{self.host}/{self._key}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Leave a connection that broke: its browser has gone."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)

    def take_key(self, key: str) -> bool:
        """Return whether this is the key of `first_url`, which then holds no longer."""
        with self._keys:
            is_right = secrets.compare_digest(key.encode(), self._key.encode())
            if is_right:
                self._key = secrets.token_urlsafe(32)
            return is_right

    def answer_run(
        self, settings: dict[str, str], *, coarse: bool = False, brief: bool = False
    ) -> dict[str, Any]:
        """Return the data of the page, or the summary only; of a docking at rest all defaults."""
        result = self.bench.compute(settings, is_coarse=coarse)
        if brief:
            return {"summary": condense(result)}
        page = make_page(result, make_command(self.bench, settings))
        return page if coarse else page | {"defaults": self.bench.find_defaults(settings)}

    def answer_stop(self, **_: Any) -> dict[str, Any]:
        """Stop what is computed."""
        self.bench.stop()
        return {}

    def _write_page(self) -> bytes:
        bench = self.bench
        data = make_page(bench.compute({}), make_command(bench, {}))
        data["live"] = {"entries": describe_entries(bench), "headings": list(SLIDERS)}
        return fill_template(
            data,
            style=read_web("live", "live.css"),
            panel=read_web("live", "panel.html"),
            script=read_web("live", "live.js"),
        ).encode()


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    server: LiveServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "dockloop", ""
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """Answer a request for the page."""
        self._answer({"": lambda: self.server.page, "first": lambda: None})

    def do_POST(self) -> None:
        """Answer a request of the page."""
        self._answer(
            {
                "run": self.server.answer_run,
                "errors": self.server.bench.estimate,  # the page has those of its own figures
                "export": partial(make_exports, self.server.bench),
                "stop": self.server.answer_stop,
            }
        )

    def log_message(self, *_: Any) -> None:
        """Keep the terminal quiet: lines would have the token in them."""

    def _answer(self, answers: dict[str, Callable[..., Any]]) -> None:
        """Check the sender, find the answer and send it; one sentence if there is none."""
        try:
            name = self._check_sender()
            if name not in answers:
                raise _RequestError(404, "there is nothing at this address")
            content = answers[name](**(self._read_body(name) if self.command == "POST" else {}))
            status = 200 if content is not None else 303
        except _RequestError as error:
            status, content = error.status, {"error": str(error)}
            self.close_connection = True  # its body is not read
        except DroppedError as error:
            status, content = 409, {"error": str(error)}
        except DockloopError as error:
            status, content = 422, {"error": str(error), "name": getattr(error, "name", "")}
        except Exception as error:  # noqa: BLE001  the page shows a defect, the server goes on
            status, content = 500, {"error": f"defect: {type(error).__name__}: {error}"}
        with suppress(ConnectionError):  # the browser has gone
            self._send(status, content)

    def _check_sender(self) -> str:
        """Return what the page on this machine asks for. Raises _RequestError for all others."""
        own, headers = self.server.host, self.headers
        if headers.get_all("Host") != [own]:
            raise _RequestError(421, f"only {own} is served: another name may be that of an attack")
        origins = headers.get_all("Origin", [] if self.command == "GET" else [""])
        sites = headers.get_all("Sec-Fetch-Site", [])
        is_foreign = any(origin != f"http://{own}" for origin in origins)
        if is_foreign or not set(sites) <= {"same-origin", "none"}:
            raise _RequestError(403, "a page of another origin is not answered")
        begin, _, name = self.path.rpartition("/")
        if not begin and self.command == "GET" and self.server.take_key(name):
            return "first"
        if not secrets.compare_digest(begin.encode(), f"/{self.server.token}".encode()):
            raise _RequestError(403, "the address must have the token that the command has printed")
        return name

    def _read_body(self, name: str) -> dict[str, Any]:
        """Return the checked members of a request. Raises _RequestError."""
        length = self.headers.get("Content-Length", "")
        if "Transfer-Encoding" in self.headers or not re.fullmatch(r"[0-9]{1,9}", length):
            raise _RequestError(411, "a request must state its length")
        if int(length) > _LARGEST:
            raise _RequestError(413, f"a request has at most {_LARGEST} bytes")
        if self.headers.get("Content-Type") != "application/json":
            raise _RequestError(415, "a request must be of type application/json")
        try:
            members = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            raise _RequestError(400, "a request must be JSON") from None
        kinds: dict[str, type] = {"settings": dict}
        if name == "run":
            kinds |= {"coarse": bool, "brief": bool}
        if not isinstance(members, dict) or not members.keys() <= kinds.keys():
            raise _RequestError(400, f"'{name}' takes no members but {', '.join(kinds)}")
        if wrong := [key for key in members if type(members[key]) is not kinds[key]]:
            raise _RequestError(400, f"'{wrong[0]}' is of another type")
        settings = members.setdefault("settings", {})
        texts = [*settings, *settings.values()]
        is_text = all(isinstance(text, str) and 0 < len(text) <= _LONGEST for text in texts)
        if len(settings) > _MOST or not is_text:
            raise _RequestError(
                400, f"settings are at most {_MOST} texts by name, of 1 to {_LONGEST} characters"
            )
        return members

    def _send(self, status: int, content: Any) -> None:
        is_page = isinstance(content, bytes)
        body = content if is_page else json.dumps(content, allow_nan=False).encode()
        self.send_response(status)
        self.send_header("Content-Type", "text/html" if is_page else "application/json")
        self.send_header("Content-Length", str(len(body)))
        if status == 303:
            self.send_header("Location", self.server.url)
        self.send_header("Content-Security-Policy", _find_policy(body) if is_page else "sandbox")
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)


def _find_policy(page: bytes) -> str:
    """Return what the page may do: its own scripts, requests to this server, nothing else."""
    scripts = re.findall(rb"<script>(.*?)</script>", page, re.DOTALL)
    digests = (base64.b64encode(hashlib.sha256(script).digest()).decode() for script in scripts)
    own = " ".join(f"'sha256-{digest}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {own}; style-src 'unsafe-inline'; img-src data: blob:;"
        " connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
