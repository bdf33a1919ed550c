"""Arguments of ``dockloop map``, in a module that loads quickly."""

import argparse
from pathlib import Path

from dockloop.arguments import (
    add_limit,
    add_processes,
    add_range,
    add_run_options,
    add_scene,
    positive,
)

EXAMPLE = (
    "example: dockloop map idss_25t_350t --x contact.stiffness 1e4 1e10 --y experiment.step 1e-4 1"
)


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Describe the arguments of the command."""
    add_scene(command)
    for letter in "xy":
        add_range(command, letter)
    for letter in "xy":
        command.add_argument(
            f"--linear-{letter}",
            action="store_true",
            help="equal steps are equal differences (default: equal ratios)",
        )
    command.add_argument(
        "--error",
        type=float,
        default=1e-2,
        metavar="E",
        help="relative error of peak loads, stroke, time of capture and final motion up to which a"
        " point is right (default: 1e-2)",
    )
    command.add_argument(
        "--points",
        type=positive,
        default=33,
        metavar="N",
        help="points along each range where verdicts change (default: 33); elsewhere a quarter",
    )
    command.add_argument(
        "--host",
        choices=("chaser", "target"),
        default="",
        help="integrate this vehicle outside, with the mass of the scene; its mass on an axis is"
        " then what the docking receives",
    )
    add_limit(command, "a point")
    add_run_options(command)
    add_processes(command)
    command.add_argument(
        "--resume", action="store_true", help="go on with the points that are there"
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FOLDER",
        help="for page, picture, table, summary and journal (default: build/maps/SCENE)",
    )
    command.add_argument("--no-plots", action="store_true", help="do not draw the picture")
    command.add_argument("--json", action="store_true", help="print the summary as JSON")
