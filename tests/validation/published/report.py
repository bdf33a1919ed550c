"""Compares dockloop with what was published. Writes tests/validation/published.md, with figures.

A script and no command of dockloop: the cases are tests of this project, and the product must not
import tests. Exact comparisons are in the plain test suite, trends in the long one
(tests/test_published.py); scenarios are only in the page.

Examples:
    .venv/bin/python tests/validation/published/report.py             # all cases and the page
    .venv/bin/python tests/validation/published/report.py --case A    # one case, on the terminal
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "studies"))

from case import Case, Comparison
from cases import CASES

from dockloop.base.paths import ROOT
from page import Block, Table, list_blocks, make_parser, write_page, write_points, write_table

PAGE, FIGURES = ROOT / "tests" / "validation" / "published.md", Path(__file__).parent / "figures"
STRENGTHS = ("exact", "trend", "scenario")

CLAIM = (
    "> dockloop is verified against closed forms, and consistent with published trends, ratios and"
    " time scales of the Soyuz and Apollo docking mechanisms as far as the tables below agree. It"
    " is not validated against measured force histories."
)
INTRODUCTION = f"""
No published case with all parameters and measured curves was available. So this page has three
kinds of comparisons, which are not equally strong:

| kind | compared with | a failure |
|---|---|---|
| exact | closed forms and independent solutions | fails the test suite |
| trend | published order, sign, ratio, scale | fails the release run, if no reason is stated here |
| scenario | a requirement or a story without numbers | is reported |

Bands come from the sources and were fixed before the runs. The docking rigs of the time reproduced
loads within 5 to 15 % (Syromiatnikov, pages 289, 298, 301). A comparison with hardware cannot claim
more than that.

What users may quote:

{CLAIM}

*Given*: stated in the source. *Assumed*: chosen here, as the source does not state it or the number
is lost. *Derived*: follows from given numbers. What is assumed in the shipped mechanisms, and what
to measure first: [parameters.md](parameters.md).
"""
CLOSING = """
## What follows for the shipped parameters

Nothing was changed: no published number replaces a shipped one alone. Findings that speak for a
change, which needs masses, springs and brakes of one and the same unit:

* The rotating parts of `apda` have 122 kg referred to the ring, with ring and rods 191 kg.
  Published are 205 and later 170 kg for the rotating parts of the original.
* The compression of `apda` can exceed its rating within the box (case H). The two last rows show
  the same dockings with a softer contact, which the elasticities name first (parameters.md).
* The angular and lateral motions of all rings last differently from those of the original (case E).
* The differential unit of `apda` has less advantage over independent legs than published (case D).

## What is missing

* Measured force histories. With them, `dockloop compare RESULT DATA.csv` lays data over a run.
* Scans of pages 26, 74, 148, 186 to 188, 213, 214, 239, 243 and 258 of the book: masses, springs
  and the plotted force of the qualification tests. With these, cases A and C become comparisons
  within 5 to 15 %.
* Schliesing 1972, and NASA TN D-6854: loads of Apollo dockings in numbers.
"""


def run_case(case: Case) -> dict[str, list[Comparison]]:
    """Run all comparisons of a case."""
    found = {}
    for strength in STRENGTHS:
        compare = getattr(case, strength)
        if compare is not None:
            began = time.perf_counter()
            found[strength] = compare()
            seconds = time.perf_counter() - began
            print(f"{case.letter} {strength}: {seconds:.1f} s", file=sys.stderr)
    return found


def count_agreeing(rows: list[Comparison] | None) -> str:
    """Return how many comparisons agree, of how many."""
    return f"{sum(row.agrees for row in rows)} of {len(rows)}" if rows else "-"


def write_comparisons(rows: list[Comparison], strength: str) -> list[Block]:
    """Return the table of comparisons of one strength."""
    table = Table(strength, "dockloop", "expected", "band", "verdict")
    for row in rows:
        verdict = f"**{row.verdict}**" if not row.agrees else row.verdict
        table.add(row.what, row.found, row.expected, row.band, verdict)
    reasons = write_points(f"{row.what}: {row.reason}" for row in rows if row.reason)
    return [table, *(["Why comparisons fail:", reasons] if reasons else [])]


def draw_case(case: Case) -> Path:
    """Draw the figure of a case."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    case.figure(axes)
    axes.grid(alpha=0.3)
    FIGURES.mkdir(exist_ok=True)
    file = FIGURES / f"{case.letter}.png"
    figure.savefig(file, dpi=80, metadata={"Software": "tests/validation/published/report.py"})
    return file


def write_case(case: Case, found: dict[str, list[Comparison]]) -> list[Block]:
    """Return the section of a case."""
    inputs = (vars(row).values() for row in case.inputs)
    blocks: list[Block] = [
        f"## {case.letter}. {case.title}",
        f"Source: {case.source}.",
        case.words,
        write_table(("input", "value", "origin", "where"), inputs),
        *(write_comparisons(rows, strength) for strength, rows in found.items()),
    ]
    if case.figure is not None:
        blocks.append(f"![{case.title}]({draw_case(case).relative_to(PAGE.parent).as_posix()})")
    return blocks


def main() -> int:
    """Run cases; write the page, or print one case."""
    parser = make_parser(__doc__)
    parser.add_argument("--case", choices=[case.letter for case in CASES], help="only this case")
    options = parser.parse_args()
    chosen = [case for case in CASES if options.case in (None, case.letter)]
    found = {case.letter: run_case(case) for case in chosen}
    if options.case:
        for strength, rows in found[options.case].items():
            print(*list_blocks(write_comparisons(rows, strength)), sep="\n\n")
        return 0
    table = Table("case", "source", *STRENGTHS)
    for case in chosen:
        counts = [count_agreeing(found[case.letter].get(strength)) for strength in STRENGTHS]
        table.add(f"{case.letter}. {case.title}", case.source, *counts)
    write_page(
        PAGE,
        "Compared with what was published",
        "tests/validation/published/report.py",
        INTRODUCTION,
        "Comparisons that agree, of all:",
        table,
        (write_case(case, found[case.letter]) for case in chosen),
        CLOSING,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
