"""Figures as PNG files. Without matplotlib there are none, and everything else is still written."""

from pathlib import Path
from typing import Any

from dockloop.errors import warn
from dockloop.outputs import figure_kind, writing


def can_draw() -> bool:
    """Return whether figures can be drawn; says in one line what is missing if not."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        warn(f"no figures are drawn ({error}): install it by .venv/bin/pip install matplotlib")
        return False
    return True


def save_figure(figure: Any, path: Path, command: str) -> None:
    """Write a figure in which the command leaves its name. Raises like `outputs.writing`."""
    with writing(path, figure_kind(command)) as partial:
        figure.savefig(partial, format="png", dpi=100, metadata={"Software": command})
