"""Pages of measured figures, which the studies write into tests/validation/, and calls for them.

A study measures, and names the blocks of its page: texts, and tables as `Table` makes them.
"""

import argparse
import platform
import re
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Union

from dockloop.base import sections
from dockloop.base.paths import ROOT, shown

Block = Union[str, "Table", Iterable["Block"]]


def call(*words: object) -> str:
    """Run a program and return what it prints; stop with its message if it fails."""
    made = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    if made.returncode:
        raise SystemExit(f"{' '.join(map(str, words))}: {made.stderr.strip()}")
    return made.stdout


class Table:
    """A table of a page: heads, then rows."""

    def __init__(self, *heads: str) -> None:
        self._rows: list[tuple[Any, ...]] = [heads]

    def add(self, *cells: object) -> None:
        """Add a row."""
        self._rows.append(cells)

    def __str__(self) -> str:
        return "\n".join(sections.write_table(self._rows))


def write_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> Table:
    """Return a table whose rows are known."""
    table = Table(*heads)
    for row in rows:
        table.add(*row)
    return table


def write_points(points: Iterable[str]) -> str:
    """Return a list of a page, one line for each point."""
    return "\n".join(f"* {point}" for point in points)


def make_parser(about: str | None, page: Path | None = None) -> argparse.ArgumentParser:
    """Return the parser of a study; with a page, which can be another one (``-o``)."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if page:
        parser.add_argument("-o", "--output", type=Path, default=page, help="the page")
    return parser


def find_commit(clone: Path = ROOT) -> str:
    """Return commit and date of a clone."""
    git = ["git", "-C", str(clone), "log", "-1", "--format=%h of %cs"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    return commit or "unknown"


def find_origin(command: str) -> str:
    """Return the sentence that says what made a page, from which state of the project."""
    return (
        f"Written by `.venv/bin/python {command}`, after commit {find_commit()}, on"
        f" {platform.machine()} {platform.system()}."
    )


def list_blocks(*blocks: Block) -> Iterator[str]:
    """Yield blocks as texts, also those in lists; empty ones are left out."""
    for block in blocks:
        if isinstance(block, str | Table):
            if text := str(block).strip("\n"):
                yield text
        else:
            yield from list_blocks(*block)


def write_page(path: Path, title: str, command: str, *blocks: Block) -> None:
    """Write a page and say where it is; `command` made it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "\n\n".join(list_blocks(f"# {title}", find_origin(command), *blocks))
    path.write_text(text + "\n", encoding="utf-8")
    print(shown(path))


def replace_section(path: Path, title: str, command: str, *blocks: Block) -> None:
    """Write one section of a page anew, with its own origin; the others stay."""
    text = path.read_text(encoding="utf-8")
    made = "\n\n".join(list_blocks(f"## {title}", find_origin(command), *blocks)) + "\n"
    section = re.compile(rf"^## {re.escape(title)}\n.*?(?=\n## |\Z)", re.DOTALL | re.MULTILINE)
    changed, count = section.subn(lambda _: made, text)
    if count != 1:
        raise ValueError(f"{shown(path)} has {count} sections '{title}': write the whole page")
    path.write_text(changed, encoding="utf-8")
    print(shown(path))
