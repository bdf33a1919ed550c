"""``dockloop map``: where a scene holds, over two quantities."""

from dockloop.commands.arguments import Command, Options, finite, positive
from dockloop.commands.console import write_found

EXAMPLE = (
    "example: dockloop map absorber_1d --x chaser.mass 1e2 1e6 --y experiment.step 1e-3 1"
    " --points 5"
)


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    for letter in "xy":
        command.add_range(letter)
    for letter in "xy":
        text = "equal steps are equal differences (default: equal ratios)"
        command.add_flag(f"--linear-{letter}", text)
    command.add_option(
        "--error",
        "E",
        "relative error of peak loads, stroke, time of capture and final motion up to which a"
        " point is right (default: 1e-2)",
        type=finite,
        default=1e-2,
    )
    text = "points along each range where verdicts change (default: 33); elsewhere a quarter"
    command.add_option("--points", "N", text, type=positive, default=33)
    command.add_argument(
        "--host",
        choices=("chaser", "target"),
        default="",
        help="integrate this vehicle outside, with the mass of the scene; its mass on an axis is"
        " then what the docking receives",
    )
    command.add_limit("a point")
    command.add_run()
    command.add_accuracy()
    command.add_assured()
    command.add_workers()
    command.add_flag("--resume", "go on with the points that are there")
    text = "for page, picture, table, summary and journal (default: build/maps/SCENE)"
    command.add_output("FOLDER", text)
    command.add_flag("--no-plots", "do not draw the picture")
    command.add_flag("--json", "print the summary as JSON")


def run(options: Options) -> None:
    """Map right, refused and wrong: page, picture, table."""
    from dockloop.studies.maps.command import run_command
    from dockloop.studies.maps.report import report_map

    write_found(options, run_command(options), report_map)
