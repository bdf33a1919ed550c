"""``dockloop check``: whether a mechanism, or the vehicles of a scene, are sound."""

from dockloop.base.errors import UsageError
from dockloop.commands.arguments import Command, Options, file_path
from dockloop.commands.console import write_found

EXAMPLE = "example: dockloop check apda --draw apda.svg"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "mechanism",
        metavar="MECHANISM",
        help="name or .json file, or a scene .toml: parts of its vehicles",
    )
    text = "evaluate the mechanism at these states and print accelerations and forces as JSON"
    command.add_option("--states", "FILE.json", text, type=file_path)
    text = "draw bodies, joints, cuts and force elements at home; of a scene also the hulls"
    command.add_option("--draw", "FILE.svg", text, type=file_path)
    command.add_flag("--json", "print the report as JSON")


def run(options: Options) -> None:
    """Check the mechanism, and draw it."""
    from dockloop.scene.mechanism import check_mechanism, draw, draw_scene, report_mechanism

    if options.draw and options.states:
        raise UsageError("--draw shows the mechanism at home: leave --states away")
    if options.draw and options.draw.suffix != ".svg":
        raise UsageError(f"--draw {options.draw}: must end in .svg")
    if options.mechanism.endswith(".toml"):
        from dockloop.runs.vehicle_check import check_vehicles, report_vehicles

        if options.states:
            raise UsageError("--states belongs to a mechanism: leave it away")
        found = check_vehicles(options.mechanism)
        if options.draw:
            draw_scene(options.mechanism, options.draw)
        write_found(options, found, report_vehicles)
        return
    report = check_mechanism(options.mechanism, options.states)
    if options.draw:
        draw(options.mechanism, report, options.draw)
    options.json |= options.states is not None
    write_found(options, report, report_mechanism)
