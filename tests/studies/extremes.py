"""The numerical extremes over their full ranges, as a page.

Runs every item of ``dockloop extremes``. Written to tests/validation/extremes.md: its table, some
refusals of each part, and what is bad. ``tests/test_extremes.py`` runs the shorter ranges.

    .venv/bin/python tests/studies/extremes.py            # some minutes
"""

import re

from dockloop.extremes import describe, run_extremes
from dockloop.paths import ROOT
from dockloop.results import ProgressBar
from page import find_origin, write_page

REASONS = 3  # refusals shown of each part
WORDS = """
Each case must be *right* or *refused*. Right: within a stated limit of a stated oracle. Refused:
with a reason, and the state is unchanged. Every other result is *bad*, and the command fails.
`dockloop extremes --item N` repeats an item. Brackets: the shorter range of `--quick`, which
`tests/test_extremes.py` runs.

* A touch that begins and ends within one inner step is not found.
* Energy drifts steadily in long runs, in proportion to the tolerance.
* Odd powers of 2 of the mass change the last digit.
"""


def main() -> None:
    """Write the page."""
    write(run_extremes([], False, ProgressBar("extremes")))


def write(rows: list[dict]) -> None:
    """Write the page of the rows of all parts."""
    short = [{**row, "reasons": row["reasons"][:REASONS]} for row in rows]
    table = re.sub(r"^  ", "* ", describe(short), flags=re.MULTILINE)
    table = re.sub(
        r"^(refusals|bad).*:$", lambda found: f"## {found[1].capitalize()}\n", table, flags=re.M
    )
    write_page(
        ROOT / "tests" / "validation" / "extremes.md",
        "# Numerical extremes",
        find_origin("tests/studies/extremes.py"),
        WORDS,
        table,
    )


if __name__ == "__main__":
    main()
