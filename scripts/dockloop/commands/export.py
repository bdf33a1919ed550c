"""``dockloop export``: a mechanism as MJCF."""

from pathlib import Path

from dockloop.commands.arguments import Command, Options
from dockloop.commands.console import write

EXAMPLE = "example: dockloop export hexapod -o hexapod.xml"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument("mechanism", metavar="MECHANISM", help="name or .json file")
    command.add_output("FILE.xml", "default: mechanism.xml", Path("mechanism.xml"))


def run(options: Options) -> None:
    """Write the mechanism, and say what became of its parts."""
    from dockloop.exchange.exporting import describe, export_mechanism

    write(describe(export_mechanism(options.mechanism, options.output), options.output))
