"""Pages of measured figures, which the studies write into tests/validation/, and calls for them."""

import platform
import re
import subprocess
from pathlib import Path

from dockloop.paths import ROOT, shown


def call(*words: object) -> str:
    """Run a program and return what it prints; stop with its message if it fails."""
    made = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    if made.returncode:
        raise SystemExit(f"{' '.join(map(str, words))}: {made.stderr.strip()}")
    return made.stdout


def write_row(*cells: object) -> str:
    """Return one line of a Markdown table."""
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def write_head(*cells: str) -> list[str]:
    """Return the first two lines of a Markdown table."""
    return [write_row(*cells), "|" + "---|" * len(cells)]


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


def write_page(path: Path, title: str, origin: str, *lines: str) -> None:
    """Write a page and say where it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join((title, "", origin, *lines)) + "\n", encoding="utf-8")
    print(shown(path))


def replace_section(path: Path, title: str, origin: str, *lines: str) -> None:
    """Write one section of a page anew, with its own origin; the others stay."""
    text = path.read_text(encoding="utf-8")
    made = "\n".join((f"## {title}", "", origin, *lines)) + "\n"
    section = re.compile(rf"^## {re.escape(title)}\n.*?(?=\n## |\Z)", re.DOTALL | re.MULTILINE)
    changed, count = section.subn(lambda _: made, text)
    if count != 1:
        raise ValueError(f"{shown(path)} has {count} sections '{title}': write the whole page")
    path.write_text(changed, encoding="utf-8")
    print(shown(path))
