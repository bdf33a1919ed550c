"""``dockloop check``: whether a mechanism is sound."""

from dockloop.arguments import Command, Options, file_path
from dockloop.console import write_found
from dockloop.errors import UsageError

EXAMPLE = "example: dockloop check apda --draw apda.svg"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument("mechanism", metavar="MECHANISM", help="name or .json file")
    text = "evaluate the mechanism at these states and print accelerations and forces as JSON"
    command.add_option("--states", "FILE.json", text, type=file_path)
    text = "draw bodies, joints, cuts and force elements at home"
    command.add_option("--draw", "FILE.svg", text, type=file_path)
    command.add_flag("--json", "print the report as JSON")


def run(options: Options) -> None:
    """Check the mechanism, and draw it."""
    from dockloop.mechanism import check_mechanism, describe_report, draw

    if options.draw and options.states:
        raise UsageError("--draw shows the mechanism at home: leave --states away")
    if options.draw and options.draw.suffix != ".svg":
        raise UsageError(f"--draw {options.draw}: must end in .svg")
    report = check_mechanism(options.mechanism, options.states)
    if options.draw:
        draw(options.mechanism, report, options.draw)
    options.json |= options.states is not None
    write_found(options, report, describe_report)
