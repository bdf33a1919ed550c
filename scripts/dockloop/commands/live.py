"""``dockloop live``: a page with sliders that computes the docking anew while one moves."""

import threading

from dockloop.base.errors import warn
from dockloop.commands.arguments import Command, Options, whole
from dockloop.commands.console import write

EXAMPLE = "example: dockloop live idss_25t_350t --scene initial.closing_speed=0.05"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    text = "port of 127.0.0.1 (default: one that is free)"
    command.add_option("--port", "N", text, type=whole, default=0)
    command.add_flag("--no-browser", "print the address of the page only")


def run(options: Options) -> None:
    """Serve the page until Ctrl-C."""
    from dockloop.live.bench import Bench
    from dockloop.live.server import LiveServer

    with LiveServer(Bench(options.scene, options.overrides), options.port) as server:
        write(f"{server.url}\n", end="")
        if not options.no_browser:  # one in a terminal ends late, and needs answers before
            threading.Thread(target=_open, args=(server.first_url,), daemon=True).start()
        try:
            server.serve_forever()
        finally:
            server.bench.stop()


def _open(url: str) -> None:
    """Open a page in the browser of the user."""
    import webbrowser

    if not webbrowser.open(url):
        warn("no browser could be opened: open the address in one")
