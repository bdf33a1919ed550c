"""What is shown and imported while long work runs: a bar, packages of some work only."""

import time
from typing import Any

from dockloop.base import paths
from dockloop.base.errors import DockloopError, is_watched, say


def import_optional(name: str, package: str | None = None) -> Any:
    """Import a module that only some work needs. Raises DockloopError naming how to install it.

    Args:
        name: of the module.
        package: that has it; default: the same name.
    """
    import importlib

    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:  # a library of the system may be missing
        command = f"'pip install {package or name}'"
        if not paths.IS_INSTALLED:
            command = "\".venv/bin/pip install -e '.[review,sweep,tables]'\" in the clone"
        raise DockloopError(
            f"the package {package or name} is needed here ({error}): install it by {command}"
        ) from None
    except ValueError as error:  # a setting of the environment, such as MPLBACKEND
        raise DockloopError(
            f"the package {package or name} does not start with its settings ({error})"
        ) from None


class ProgressBar:
    """A bar on standard error; shows nothing when that is not a terminal."""

    def __init__(self, label: str) -> None:
        """Prepare a bar that begins with `label`."""
        self._label = label
        self._active = is_watched()
        self._next = 0.0

    def __call__(self, part: float, note: str = "") -> None:
        """Show that `part` (0 to 1) is done, and a note; drawn at most ten times a second."""
        now = time.monotonic()
        if not self._active or (now < self._next and part < 1.0):
            return
        self._next = now + 0.1
        bar = "#" * round(30 * part)
        end = "\r\033[K" if part >= 1.0 else ""
        text = f"\r{self._label} [{bar:30}] {part:4.0%} {note}\033[K{end}"
        say(text, end="")
