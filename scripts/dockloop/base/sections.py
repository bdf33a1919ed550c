"""One report of what a command found, and one writer each for terminal, Markdown and HTML.

A report is a list of sections. The first one is its head: what the report is about, and the
outcome. All texts are those of people; numbers come as texts.
"""

import base64
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dockloop.base.errors import one_line
from dockloop.base.files import Kind, read_head, writing
from dockloop.base.number import say_number
from dockloop.base.progress import import_optional
from dockloop.base.template import fill

FACTS = ("what", "is")  # heads of a table of names and what they are
WIDTH = 100  # of what is printed
_MOST_FILES = 5  # whose names are said
Rows = Sequence[Iterable[Any]]


@dataclass
class Section:
    """A part of a report; what is empty is left out.

    Attributes:
        title: heading.
        text: a paragraph.
        table: heads, then rows of texts, numbers and Booleans; without rows it is left out.
        points: sentences, one a line.
        commands: lines for a terminal, each with a remark.
        figures: PNG or SVG files, for pages.
        links: pages that show the motion, by remark.
    """

    title: str
    text: str = ""
    table: Rows = ()
    points: Sequence[str] = ()
    commands: Sequence[tuple[str, str]] = ()
    figures: Sequence[Path] = ()
    links: Mapping[str, Path] = field(default_factory=dict)

    def is_empty(self) -> bool:
        """Return whether there is nothing but a title."""
        has_rows = len(self.table) > 1
        return not (has_rows or self.text or self.points or self.commands or self.figures)

    def __post_init__(self) -> None:
        """Keep the title on one line: a user writes names."""
        self.title = one_line(self.title)


def write_text(report: Iterable[Section]) -> str:
    """Return a report for the terminal: at most `WIDTH` columns, but for commands."""
    return "\n".join(line for section in _choose(report) for line in _write_lines(section))


def _write_lines(section: Section) -> list[str]:
    lines = [section.title]
    for text in (section.text, *section.points):
        lines += [f"  {line}" for line in _fold(text, WIDTH - 2)]
    if len(section.table) > 1:
        rows = [[say_cell(cell) for cell in row] for row in section.table]
        lines += _align(rows[section.table[0] == FACTS :])
    for remark, command in section.commands:
        lines += [*(f"  {line}" for line in _fold(remark, WIDTH - 2)), f"    {command}"]
    return lines


def _align(rows: list[list[str]]) -> list[str]:
    """Return the lines of a table; the last text of a row is wrapped."""
    widths = [max(map(len, column)) + 2 for column in zip(*rows, strict=True)][:-1]
    start = 2 + sum(widths)
    lines = []
    for *cells, last in rows:
        head = "".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        first, *more = _fold(last, max(WIDTH - start, 20)) or [""]
        lines += [f"  {head}{first}".rstrip(), *(" " * start + part for part in more)]
    return lines


def _fold(text: str, width: int) -> list[str]:
    """Return a text as lines; a name that is longer than a line is not broken."""
    return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)


def say_cell(cell: Any) -> str:
    """Return a cell as text: nothing for None, four digits of a number that is not whole."""
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return (
        "" if cell is None else say_number(cell) if isinstance(cell, float) else one_line(str(cell))
    )


def write_markdown(report: Iterable[Section]) -> str:
    """Return a report as a Markdown page; texts and points may have marks of their own."""
    blocks: list[str] = []
    for section in _choose(report):
        blocks.append(f"{'##' if blocks else '#'} {section.title}")
        blocks += [section.text] if section.text else []
        blocks += ["\n".join(f"* {point}" for point in section.points)] if section.points else []
        blocks += ["\n".join(write_table(section.table))] if len(section.table) > 1 else []
        blocks += [f"![{section.title}]({figure.name})" for figure in section.figures]
        if section.commands:
            words = (f"# {remark}\n{command}" for remark, command in section.commands)
            blocks.append("\n".join(("```sh", *words, "```")))
    return "\n\n".join(blocks) + "\n"


def write_table(table: Rows) -> list[str]:
    """Return the lines of a Markdown table: heads, then rows."""
    heads, *rows = ([say_cell(cell).replace("|", "\\|") for cell in row] for row in table)
    lines = (f"| {' | '.join(row)} |" for row in (heads, *rows))
    return [next(lines), "|" + "---|" * len(heads), *lines]


def write_html(path: Path, command: str, report: Iterable[Section]) -> None:
    """Write a report as one page, self-contained; it opens offline. The template has its form.

    Raises:
        DockloopError: it cannot be written.
    """
    with writing(path, html_kind(command)) as partial:
        partial.write_bytes(_begin(command) + _fill(command, report).encode())


def write_pdf(path: Path, command: str, report: Iterable[Section]) -> None:
    """Write a report as a PDF: the page of `write_html` on sheets of paper.

    Raises:
        DockloopError: it cannot be written, or the package weasyprint is missing.
    """
    printer = import_optional("weasyprint")
    fonts = printer.text.fonts.FontConfiguration()
    sheet = printer.CSS(string=_list_fonts(), font_config=fonts)
    page = printer.HTML(string=_fill(command, report))
    made = page.write_pdf(stylesheets=[sheet], font_config=fonts)
    with writing(path, pdf_kind(command)) as partial:
        partial.write_bytes(made + _end(command))


def _list_fonts() -> str:
    """Return the style of letters that come with matplotlib: a machine may have none."""
    from matplotlib import get_data_path

    folder = (Path(get_data_path()) / "fonts" / "ttf").as_uri()
    faces = (
        ("DejaVuSans", "Sheet", 400),
        ("DejaVuSans-Bold", "Sheet", 700),
        ("DejaVuSansMono", "Sheet Mono", 400),
    )
    lines = (
        f"@font-face {{ font-family: '{name}'; font-weight: {weight};"
        f" src: url('{folder}/{file}.ttf') }}"
        for file, name, weight in faces
    )
    return "\n".join((*lines, "body { font-family: Sheet } pre { font-family: Sheet Mono }"))


def pdf_kind(command: str) -> Kind:
    """Return the kind of the PDF of a command, which ends with a comment."""
    return Kind("report", command, lambda path: path.read_bytes().endswith(_end(command)))


def _end(command: str) -> bytes:
    return f"\n% made by {command}\n".encode()


def _fill(command: str, report: Iterable[Section]) -> str:
    """Return the page of a report."""

    def embed(figure: Path) -> str:
        kind = "svg+xml" if figure.suffix == ".svg" else figure.suffix[1:]
        return f"data:image/{kind};base64,{base64.b64encode(figure.read_bytes()).decode()}"

    values = {"sections": _choose(report), "command": command}
    return fill("base", "report.html", **values, embed=embed, say=say_cell)


def html_kind(command: str) -> Kind:
    """Return the kind of the page of a command."""
    return Kind("report", command, lambda path: read_head(path).startswith(_begin(command)))


def _begin(command: str) -> bytes:
    return f"<!doctype html>\n<!-- made by {command} -->\n".encode()


def find_html(result: Path) -> Path:
    """Return where the page next to a result or a table is: ``own_report.html``."""
    return result.with_name(f"{result.stem}_report.html")


def _choose(report: Iterable[Section]) -> list[Section]:
    """Return the head, and the other sections that have something."""
    head, *others = report
    return [head, *(section for section in others if not section.is_empty())]


def list_files(names: Sequence[str]) -> list[tuple[str, str]]:
    """Return the fact that says what was written: a few names, or the first one and kinds."""
    if len(names) <= _MOST_FILES:
        return [("files", ", ".join(names))] if names else []
    kinds = ", ".join(sorted({Path(name).suffix[1:] for name in names[1:]}))
    return [("files", f"{names[0]}; next to it {len(names) - 1} more ({kinds})")]
