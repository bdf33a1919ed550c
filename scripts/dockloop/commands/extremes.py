"""``dockloop extremes``: random scenes and their verdicts."""

import json

from dockloop.base.errors import DockloopError
from dockloop.base.sections import write_text
from dockloop.commands.arguments import Command, Options, positive, whole
from dockloop.commands.console import write

EXAMPLE = "example: dockloop extremes --random 20 --seed 7"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_option("--random", "N", "number of scenes", type=positive, required=True)
    command.add_option("--seed", "S", "of the random numbers (default: 1)", type=whole, default=1)
    text = "number of the first one (default: 1)"
    command.add_option("--first", "K", text, type=positive, default=1)
    command.add_limit("a scene")
    command.add_workers()
    command.add_flag("--resume", "go on with the scenes of FOLDER")
    command.add_output("FOLDER", "for page and journal (default: build/extremes)")
    command.add_flag("--json", "print the report as JSON")


def run(options: Options) -> None:
    """Judge random scenes; a bad one is a failure."""
    from dockloop.studies.extremes.random_report import report_random, run_command

    summary = run_command(options)
    # The last line of the JSON is one object: programs read it after whatever came before.
    write(json.dumps(summary) if options.json else write_text(report_random(summary)))
    if summary["bad"]:
        first = summary["bad"][0]
        raise DockloopError(
            f"extremes: {len(summary['bad'])} of {summary['scenes']} scenes are bad, the first one:"
            f" {first['repeat']}: {first['reason']}"
        )
