"""Arguments that several commands share, in a module that loads quickly."""

import argparse
import math

LIMIT = 60.0  # s of processor time that a docking to be judged may take


def positive(text: str) -> int:
    """Parse a whole number above 0."""
    try:
        number = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"is {text}: must be a whole number") from None
    if number < 1:
        raise argparse.ArgumentTypeError(f"is {text}: must be at least 1")
    return number


def add_scene(command: argparse.ArgumentParser) -> None:
    """Add the scene, and the keys in which it differs from its file."""
    command.add_argument("scene", metavar="SCENE", help="name of a shipped scene, or a .toml file")
    add_scene_option(command)


def add_scene_option(command: argparse.ArgumentParser) -> None:
    """Add the keys of the scene that differ from its file."""
    command.add_argument(
        "--scene",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override a key of the scene, e.g. chaser.motion=driven (repeatable)",
    )


def add_run_options(command: argparse.ArgumentParser) -> None:
    """Add what distinguishes one run of a scene from another, next to the scene."""
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="start value of an FMU variable (repeatable)",
    )
    command.add_argument("--stop", type=float, metavar="T", help="end of the run [s]")
    command.add_argument("--step", type=float, metavar="H", help="communication step [s]")


def add_range(command: argparse.ArgumentParser, letter: str, *, is_optional: bool = False) -> None:
    """Add a quantity that goes over a range."""
    command.add_argument(
        f"--{letter}",
        nargs=3,
        required=not is_optional,
        metavar=("NAME", "LOW", "HIGH"),
        help="a quantity and its range: a key of the scene or an FMU variable"
        + (" (optional)" if is_optional else ""),
    )


def add_processes(command: argparse.ArgumentParser) -> None:
    """Add how many worker processes a command starts."""
    command.add_argument(
        "--workers", type=positive, metavar="N", help="processes (default: one per processor)"
    )


def add_limit(command: argparse.ArgumentParser, what: str) -> None:
    """Add the processor time of one docking that is judged.

    Args:
        command: `map` or `extremes`.
        what: the docking.
    """
    command.add_argument(
        "--limit",
        type=_duration,
        default=LIMIT,
        metavar="T",
        help=f"processor time of {what}: a run that needs more than a third of it is slow, one"
        f" that needs all of it is hung [s] (default: {LIMIT:g})",
    )


def _duration(text: str) -> float:
    """Parse a time above 0 [s]."""
    try:
        time = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"is {text}: must be a number of seconds") from None
    if not 0.0 < time < math.inf:
        raise argparse.ArgumentTypeError(f"is {text}: must be greater than 0 and finite [s]")
    return time


def add_executor_options(command: argparse.ArgumentParser) -> None:
    """Add where many dockings run."""
    where = command.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=positive,
        metavar="N",
        help="local threads or processes (default: one per processor)",
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="use this Dask cluster, e.g. tcp://host:8786"
    )


def add_report_option(command: argparse.ArgumentParser, file: str) -> None:
    """Add the page that is written on demand."""
    command.add_argument(
        "--report",
        action="store_true",
        help=f"write {file}: one page with words, tables, figures and commands; opens offline",
    )
