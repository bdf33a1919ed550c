"""Tables in words: numbers as people read them, rows of texts as lines of aligned columns."""

from collections.abc import Sequence


def align(rows: Sequence[Sequence[str]], indent: str) -> list[str]:
    """Return one line per row; a row has a text per column, the first row may be the heads."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        indent + "  ".join(text.ljust(w) for text, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def say_number(value: float) -> str:
    """Return a number with four digits; loads and masses need no exponent."""
    return f"{value:.0f}" if 9999.5 <= abs(value) < 1e7 else f"{value:.4g}"
