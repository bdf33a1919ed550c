"""Arguments of ``dockloop envelope``, in a module that loads quickly."""

import argparse
from pathlib import Path

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
    command.add_argument("scene", metavar="SCENE", help="name of a shipped scene, or a .toml file")
    for letter in "xyz":
        command.add_argument(
            f"--{letter}",
            nargs=3,
            required=letter != "z",
            metavar=("NAME", "LOW", "HIGH"),
            help="a quantity and its range: a key of the scene or an FMU variable"
            + (" (optional)" if letter == "z" else ""),
        )
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
    command.add_argument(
        "--scene",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override a key of the scene in all dockings (repeatable)",
    )
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="start value of an FMU variable in all dockings (repeatable)",
    )
    command.add_argument("--stop", type=float, metavar="T", help="end of a docking [s]")
    command.add_argument("--step", type=float, metavar="H", help="communication step [s]")
    where = command.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="threads (default: one per processor)"
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="use this Dask cluster, e.g. tcp://host:8786"
    )
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
    command.add_argument(
        "--report",
        action="store_true",
        help="write report.html: one page with words, tables, figure and commands; opens offline",
    )
    command.add_argument("--json", action="store_true", help="print the summary as JSON")
