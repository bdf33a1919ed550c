"""How large the project is, next to an earlier state of it.

Reads two commits with git: lines per room, largest files, longest Python functions, words and
numbers of the README, and names that the general evaluation made superfluous. Written to
tests/validation/structure.md. The earlier commit is the last one before leg blocks and rooms.

    .venv/bin/python tests/studies/structure.py               # some seconds
"""

import argparse
import ast
import io
import re
import subprocess
import sys
import tarfile
from collections import Counter
from pathlib import PurePosixPath

from dockloop.base.paths import ROOT
from page import Block, Table, find_commit, write_page, write_table

BEFORE = "3d3eb40"
CODE = {".cpp", ".hpp", ".py", ".sh", ".c", ".h", ""}
LARGEST = 8
GONE = ("by_kernel", "skips_massless", "Whole")


def read_commit(commit: str) -> dict[PurePosixPath, str]:
    """Return the text of every file of code, and of the README."""
    command = ["git", "-C", str(ROOT), "archive", "--format=tar", commit]
    packed = subprocess.run(command, capture_output=True, check=True).stdout
    texts = {}
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        for member in archive:
            path = PurePosixPath(member.name)
            is_code = path.parts[0] in ("src", "fmu", "scripts", "tests") and path.suffix in CODE
            if member.isfile() and (is_code or member.name == "README.md"):
                texts[path] = archive.extractfile(member).read().decode(errors="replace")
    return texts


def find_room(path: PurePosixPath) -> str:
    """Return the room of a file: a folder of src, or one of the top level."""
    return "/".join(path.parts[: 2 if path.parts[0] == "src" and len(path.parts) > 2 else 1])


def count_lines(text: str) -> int:
    """Return the number of lines."""
    return text.count("\n")


def count_rooms(texts: dict[PurePosixPath, str]) -> Counter:
    """Return the lines of every room, and of the product path."""
    rooms: Counter = Counter()
    for path, text in texts.items():
        if path.name == "README.md":
            continue
        rooms[find_room(path)] += count_lines(text)
        if path.parts[0] in ("src", "fmu", "scripts"):
            rooms["product path"] += count_lines(text)
    return rooms


def list_functions(texts: dict[PurePosixPath, str]) -> list[tuple[int, str]]:
    """Return the longest Python functions of the product: lines, name."""
    found = []
    for path, text in texts.items():
        if path.suffix != ".py" or path.parts[0] != "scripts":
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and node.end_lineno:
                found.append((node.end_lineno - node.lineno + 1, f"`{path.name}: {node.name}`"))
    return sorted(found, reverse=True)[:LARGEST]


def list_files(texts: dict[PurePosixPath, str]) -> list[tuple[int, str]]:
    """Return the largest files of the product: lines, name."""
    product = [p for p in texts if p.parts[0] in ("src", "fmu", "scripts")]
    found = [(count_lines(texts[path]), f"`{path}`") for path in product]
    return sorted(found, reverse=True)[:LARGEST]


def compare(texts: tuple[dict[PurePosixPath, str], ...]) -> list[Block]:
    """Return the tables of two states."""
    rooms = [count_rooms(each) for each in texts]
    names = sorted(set(rooms[0]) | set(rooms[1]))
    counts = ((name, *(each.get(name, "-") for each in rooms)) for name in names)
    blocks: list[Block] = ["## Lines per room", write_table(("room", "before", "now"), counts)]
    readme = [each[PurePosixPath("README.md")] for each in texts]
    named = Table("what", "before", "now")
    named.add("lines of the README", *map(count_lines, readme))
    named.add("words", *(len(text.split()) for text in readme))
    named.add("numbers", *(len(re.findall(r"\d[\d.e-]*", text)) for text in readme))
    code = ["\n".join(t for p, t in each.items() if p.parts[0] == "src") for each in texts]
    for name in GONE:
        counts = [len(re.findall(rf"\b{name}\b", text)) for text in code]
        named.add(f"`{name}` in src", *counts)
    blocks += ["## README, names", named]
    for title, found in (
        ("Largest files of the product", [list_files(each) for each in texts]),
        ("Longest Python functions of the product", [list_functions(each) for each in texts]),
    ):
        rows = ((*a[::-1], *b[::-1]) for a, b in zip(*found, strict=True))
        blocks += [f"## {title}", write_table(("before", "lines", "now", "lines"), rows)]
    return blocks


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", default=BEFORE, metavar="COMMIT")
    before = parser.parse_args().before
    words = f"Before: commit {before}. Now: commit {find_commit()}. Comments and blank lines count."
    write_page(
        ROOT / "tests" / "validation" / "structure.md",
        "Size and structure, then and now",
        " ".join(["tests/studies/structure.py", *sys.argv[1:]]),
        words,
        compare((read_commit(before), read_commit("HEAD"))),
    )


if __name__ == "__main__":
    main()
