"""The page of ``dockloop live`` for tests and studies: its server in a thread, and in Chromium."""

import http.client
import json
import threading
import time
from contextlib import contextmanager

from dockloop.live.bench import Bench
from dockloop.live.server import LiveServer
from dockloop.view import browser as chromium
from dockloop.view.browser import Browser

SMALL = "absorber_1d"
LONG = {"experiment.stop": "900", "solver.method": "fixed_rk4", "solver.step": "1e-4"}
REFINED = "document.getElementById('status').textContent.startsWith('as dockloop run')"


@contextmanager
def serve(scene):
    with LiveServer(Bench(scene)) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def ask(server, method="POST", path=None, body=None, **headers):
    """Return status, headers and body of an answer; a header `None` is left out."""
    sent = {"Host": server.host, "Origin": f"http://{server.host}"}
    sent |= {"Content-Type": "application/json"}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    data = body if isinstance(body, bytes) else json.dumps(body or {}).encode()
    if method == "POST":
        sent.setdefault("Content-Length", str(len(data)))
    connection = http.client.HTTPConnection(*server.server_address, timeout=60)
    try:
        target = f"/{server.token}/run" if path is None else path
        connection.putrequest(method, target, skip_host=True, skip_accept_encoding=True)
        for name, value in sent.items():
            if value is not None:
                connection.putheader(name, value)
        connection.endheaders(data if method == "POST" else None)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def list_own_options():
    """Return the options of Chromium, with the network of this machine only."""
    add = ", EXCLUDE 127.0.0.1"
    return tuple(o + add if "resolver" in o else o for o in chromium._OPTIONS)


class Online(Browser):
    """A page of this machine in Chromium, with the network of this machine only."""

    def open(self, url):
        self.call(
            "Network.emulateNetworkConditions",
            offline=False,
            latency=0,
            downloadThroughput=-1,
            uploadThroughput=-1,
        )
        self.call("Page.navigate", url=url)
        self.wait("window.live && window.dockloop")

    def wait(self, code):
        """Wait until an expression is true."""
        end = time.monotonic() + 120.0
        while not self.run(f"Boolean({code})"):
            assert time.monotonic() < end, (code, self.messages[-5:])
            time.sleep(0.05)

    def read(self, name):
        return self.run(f"document.getElementById({name!r}).textContent")

    def find_bad(self):
        noise = ("warning: [.WebGL", "warning: [GroupMarker", "request: http://127.0.0.1:")
        refused = "the server responded with a status of 4"  # what is refused, and shown
        return [m for m in self.messages if not m.startswith(noise) and refused not in m]
