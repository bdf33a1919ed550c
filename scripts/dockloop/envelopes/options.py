"""Arguments of ``dockloop envelope``, in a module that loads quickly."""

import argparse
from pathlib import Path

from dockloop.arguments import (
    add_executor_options,
    add_range,
    add_report_option,
    add_run_options,
    add_scene,
)

EXAMPLE = (
    "example: dockloop envelope idss_25t_350t --x initial.lateral_offset 0 0.2"
    ' --y initial.closing_speed 0.01 0.15 --criterion "captured within 5 s and load_ratio < 1"'
)
CRITERIA = (
    'a condition, e.g. "captured within 5 s and load_ratio < 1": captured, contact, rebound, miss;'
    " comparisons of outputs at the end, of peak loads (compression, ..., load_ratio) and of what"
    " varies; and, or, not. 'within' counts from first contact (repeatable: same dockings)"
)


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Describe the arguments of the command."""
    add_scene(command)
    for letter in "xyz":
        add_range(command, letter, is_optional=letter == "z")
    command.add_argument(
        "--criterion",
        dest="criteria",
        action="append",
        required=True,
        metavar="TEXT",
        help=CRITERIA,
    )
    command.add_argument(
        "--log", default="", metavar="xyz", help="these quantities in equal ratios, e.g. --log xy"
    )
    command.add_argument(
        "--tolerance",
        type=float,
        metavar="PART",
        help="the boundary is found within this part of each range (default: 0.01; 0.04 with --z)",
    )
    command.add_argument(
        "--coarse",
        type=int,
        metavar="N",
        help="cells along a range at the beginning; what is smaller may be missed (default: 8; 4"
        " with --z)",
    )
    command.add_argument(
        "--check",
        type=int,
        default=16,
        metavar="N",
        help="dockings at random away from the boundary, to find what was missed (default: 16)",
    )
    command.add_argument("--seed", type=int, default=0, metavar="N", help="of these (default: 0)")
    add_run_options(command)
    add_executor_options(command)
    command.add_argument(
        "--resume",
        action="store_true",
        help="go on with the dockings that are there: after Ctrl-C, with other criteria, ranges, or"
        " a smaller tolerance",
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="for tables, figure, summary and journal (default: build/envelopes/SCENE)",
    )
    command.add_argument("--no-plots", action="store_true", help="do not draw the figure")
    add_report_option(command, "report.html")
    command.add_argument("--json", action="store_true", help="print the summary as JSON")
