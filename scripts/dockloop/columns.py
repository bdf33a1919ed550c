"""Tables in words: numbers as people read them, rows of texts as lines of aligned columns."""

import textwrap
from collections.abc import Sequence

WIDTH = 100  # of a table whose last column is text


def align(rows: Sequence[Sequence[str]], indent: str) -> list[str]:
    """Return one line per row; a row has a text per column, the first row may be the heads."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        indent + "  ".join(text.ljust(w) for text, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def wrap(rows: Sequence[Sequence[str]], indent: str) -> list[str]:
    """Return the lines of `align` with at most `WIDTH` columns: the last text of a row is wrapped.

    A name that is longer than the rest of the line is not broken.
    """
    texts = align([row[:-1] for row in rows], "")
    start = len(indent) + max(map(len, texts)) + 2
    lines = []
    for head, row in zip(texts, rows, strict=True):
        parts = textwrap.wrap(
            row[-1], max(WIDTH - start, 20), break_long_words=False, break_on_hyphens=False
        )
        first, *more = parts or [""]
        lines.append(f"{indent}{head}".ljust(start) + first)
        lines += [" " * start + part for part in more]
    return [line.rstrip() for line in lines]


def say_number(value: float) -> str:
    """Return a number with four digits; loads and masses need no exponent."""
    return f"{value:.0f}" if 9999.5 <= abs(value) < 1e7 else f"{value:.4g}"
