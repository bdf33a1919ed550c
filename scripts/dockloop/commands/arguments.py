"""The parser of a command, with the arguments that several commands share; it loads quickly."""

import argparse
import re
from argparse import Namespace as Options
from pathlib import Path
from typing import Any, NoReturn

from dockloop.base.errors import UsageError, one_line
from dockloop.base.number import read_number, read_whole
from dockloop.base.words import LIMIT

__all__ = [
    "Command",
    "Options",
    "file_path",
    "filled",
    "finite",
    "positive",
    "whole",
]


def filled(text: str) -> str:
    """Parse a text that is not empty."""
    if not text.strip():
        raise argparse.ArgumentTypeError("is empty: must have a value")
    return text


def file_path(text: str) -> Path:
    """Parse the name of a file or folder."""
    return Path(filled(text))


def finite(text: str) -> float:
    """Parse a finite number."""
    try:
        return read_number(text)
    except ValueError:
        wrong = f"is {text or 'empty'}: must be a finite number"
        raise argparse.ArgumentTypeError(wrong) from None


def whole(text: str) -> int:
    """Parse a whole number."""
    try:
        return read_whole(text)
    except ValueError:
        wrong = f"is {text or 'empty'}: must be a whole number"
        raise argparse.ArgumentTypeError(wrong) from None


def positive(text: str) -> int:
    """Parse a whole number above 0."""
    number = whole(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"is {text}: must be at least 1")
    return number


def _duration(text: str) -> float:
    """Parse a time above 0 [s]."""
    time = finite(text)
    if time <= 0.0:
        raise argparse.ArgumentTypeError(f"is {text}: must be greater than 0 [s]")
    return time


class Command(argparse.ArgumentParser):
    """A parser whose errors are one sentence, like all others."""

    def __init__(self, **more: Any) -> None:
        """Make a parser in which -1e-3 is a number, and no option."""
        super().__init__(**more)
        self._negative_number_matcher = re.compile(r"-(\.?\d|inf|nan)")

    def error(self, message: str) -> NoReturn:
        """Leave the program with one sentence."""
        text = one_line(f"{self.prog}: {message}; see {self.prog} --help")
        self.exit(UsageError.exit_status, f"{text}\n")

    def add_option(self, name: str, metavar: str | None, text: str, **more: Any) -> None:
        """Add an option with a value."""
        self.add_argument(name, metavar=metavar, help=text, **({"type": filled} | more))

    def add_flag(self, name: str, text: str) -> None:
        """Add something that is on if it is given."""
        self.add_argument(name, action="store_true", help=text)

    def add_list(self, name: str, member: str, metavar: str, text: str, **more: Any) -> None:
        """Add something that may be given again and again, as the list `member` of the options."""
        more = {"dest": member, "action": "append", "default": []} | more
        self.add_option(name, metavar, text, **more)

    def add_output(self, metavar: str, text: str, default: Path | None = None) -> None:
        """Add the file or folder that the command writes."""
        more: dict[str, Any] = {"type": file_path, "default": default, "metavar": metavar}
        self.add_argument("-o", "--output", help=text, **more)

    def add_report(self, file: str) -> None:
        """Add the page that is written on demand."""
        text = f"write {file}: one page with words, tables, figures and commands; opens offline"
        self.add_flag("--report", text)

    def add_scene(self) -> None:
        """Add the scene, and the keys in which it differs from its file."""
        self.add_argument("scene", metavar="SCENE", help="name of a shipped scene, or a .toml file")
        self.add_scene_keys()

    def add_scene_keys(self) -> None:
        """Add the keys of the scene that differ from its file."""
        text = "override a key of the scene, e.g. chaser.motion=driven (repeatable)"
        self.add_list("--scene", "overrides", "KEY=VALUE", text)

    def add_run(self) -> None:
        """Add what distinguishes one run of a scene from another, next to the scene."""
        self.add_list("--set", "set", "NAME=VALUE", "start value of an FMU variable (repeatable)")
        self.add_option("--stop", "T", "end of the run [s]", type=finite)
        self.add_option("--step", "H", "communication step [s]", type=finite)

    def add_kernel(self) -> None:
        """Add whether an FMU that is built has a kernel."""
        self.add_argument(
            "--kernel",
            action=argparse.BooleanOptionalAction,
            help="with compiled code of its own for the mechanism, or without (default: with it"
            " where there is a C compiler; results are the same but for rounding)",
        )

    def add_assured(self) -> None:
        """Add that every figure shall be within the wanted accuracy."""
        self.add_flag(
            "--assured",
            "run again with tighter settings until two runs agree within the accuracy, which must"
            " be stated; name the figures on which no runs agree",
        )

    def add_accuracy(self) -> None:
        """Add the wanted error of many dockings, as for one."""
        text = "wanted relative error of all dockings, or real-time: as --set accuracy=ERROR"
        self.add_option("--accuracy", "ERROR", text)

    def add_fitted(self, text: str) -> None:
        """Add the result of a fit, whose parameters vary."""
        self.add_option("--from", "FIT.json", text, dest="fitted")

    def add_range(self, letter: str, *, is_optional: bool = False) -> None:
        """Add a quantity that goes over a range."""
        self.add_argument(
            f"--{letter}",
            nargs=3,
            type=filled,
            required=not is_optional,
            metavar=("NAME", "LOW", "HIGH"),
            help="a quantity and its range: a key of the scene or an FMU variable"
            + (" (optional)" if is_optional else ""),
        )

    def add_limit(self, what: str) -> None:
        """Add the processor time of one docking that is judged; `what` names the docking."""
        self.add_option(
            "--limit",
            "T",
            f"processor time of {what}: a run that needs more than a third of it is slow, one"
            f" that needs all of it is hung [s] (default: {LIMIT:g})",
            type=_duration,
            default=LIMIT,
        )

    def add_workers(self) -> None:
        """Add how many worker processes the command starts."""
        text = "processes (default: one per processor)"
        self.add_option("--workers", "N", text, type=positive)

    def add_executor(self) -> None:
        """Add where many dockings run."""
        where = self.add_mutually_exclusive_group()
        where.add_argument(
            "--workers",
            type=positive,
            metavar="N",
            help="local threads or processes (default: one per processor)",
        )
        where.add_argument(
            "--scheduler",
            type=filled,
            metavar="ADDRESS",
            help="use this Dask cluster, e.g. tcp://host:8786",
        )
