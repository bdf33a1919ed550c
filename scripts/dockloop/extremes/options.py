"""Arguments of ``dockloop extremes``, in a module that loads quickly."""

import argparse
from pathlib import Path

from dockloop.arguments import add_limit, add_processes, positive

EXAMPLE = "example: dockloop extremes --random 200 --seed 7"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "--random", type=positive, required=True, metavar="N", help="number of scenes"
    )
    command.add_argument(
        "--seed", type=int, default=1, metavar="S", help="of the random numbers (default: 1)"
    )
    command.add_argument(
        "--first",
        type=positive,
        default=1,
        metavar="K",
        help="number of the first one (default: 1)",
    )
    add_limit(command, "a scene")
    add_processes(command)
    command.add_argument("--resume", action="store_true", help="go on with the scenes of FOLDER")
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="for page and journal (default: build/extremes)",
    )
    command.add_argument("--json", action="store_true", help="print the report as JSON")
