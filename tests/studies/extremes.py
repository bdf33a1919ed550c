"""The numerical extremes over their full ranges, as a page.

Runs every item of ``tests/extreme_cases``. Written to tests/validation/extremes.md: its table, some
refusals of each part, and what is bad. With ``--item`` or ``--quick`` the table is printed only.

    .venv/bin/python tests/studies/extremes.py                        # some minutes
    .venv/bin/python tests/studies/extremes.py --item 10 --quick      # the shorter ranges
"""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dockloop.base.paths import ROOT
from dockloop.base.progress import ProgressBar
from extreme_cases import describe, run_extremes
from page import make_parser, write_page

REASONS = 3  # refusals shown of each part
WORDS = """
Each case must be *right* or *refused*. Right: within a stated limit of a stated oracle. Refused:
with a reason, and the state is unchanged. Every other result is *bad*.
`.venv/bin/python tests/studies/extremes.py --item N` repeats an item. Brackets: the shorter range
of `--quick`, which `tests/test_extremes.py` runs.

* A touch that begins and ends within one inner step is not found.
* Energy drifts steadily in long runs, in proportion to the tolerance.
* Odd powers of 2 of the mass change the last digit.
"""


def main() -> None:
    """Write the page, or print a table."""
    parser = make_parser(__doc__)
    parser.add_argument(
        "--item", dest="items", action="append", type=int, default=[], metavar="N", help="1 to 12"
    )
    parser.add_argument("--quick", action="store_true", help="the shorter ranges")
    options = parser.parse_args()
    rows = run_extremes(options.items, options.quick, ProgressBar("extremes"))
    if options.items or options.quick:
        print(describe(rows))
    else:
        write(rows)


def write(rows: list[dict]) -> None:
    """Write the page of the rows of all parts."""
    short = [{**row, "reasons": row["reasons"][:REASONS]} for row in rows]
    table = re.sub(r"^  ", "* ", describe(short), flags=re.MULTILINE)
    table = re.sub(
        r"^(refusals|bad).*:$", lambda found: f"## {found[1].capitalize()}\n", table, flags=re.M
    )
    write_page(
        ROOT / "tests" / "validation" / "extremes.md",
        "Numerical extremes",
        "tests/studies/extremes.py",
        WORDS,
        table,
    )


if __name__ == "__main__":
    main()
