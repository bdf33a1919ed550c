"""Arguments of ``dockloop extremes``, in a module that loads quickly."""

import argparse
from pathlib import Path

from dockloop.arguments import add_limit, add_processes, positive

EXAMPLE = "example: dockloop extremes --item 10 --quick"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "--item",
        dest="items",
        action="append",
        type=int,
        default=[],
        metavar="N",
        help="only this item, 1 to 12 (repeatable); default: all",
    )
    command.add_argument(
        "--quick", action="store_true", help="the shorter ranges, about a minute in all"
    )
    command.add_argument(
        "--random", type=positive, metavar="N", help="judge N random scenes instead of the items"
    )
    command.add_argument("--seed", type=int, default=1, metavar="S", help="of these (default: 1)")
    command.add_argument(
        "--first",
        type=positive,
        default=1,
        metavar="K",
        help="number of the first one (default: 1)",
    )
    add_limit(command, "a random scene")
    add_processes(command)
    command.add_argument(
        "--resume", action="store_true", help="go on with the random scenes of FOLDER"
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="for page and journal of random scenes (default: build/extremes)",
    )
    command.add_argument("--json", action="store_true", help="print the report as JSON")
