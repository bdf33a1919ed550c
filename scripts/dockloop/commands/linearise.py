"""``dockloop linearise``: the linear model of a docking at one instant."""

from dockloop.commands.arguments import Command, Options, filled
from dockloop.commands.console import write_found

EXAMPLE = "example: dockloop linearise apda --at hard_docked --stop 200 --step 0.5"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    text = "capture, hard_docked (the first communication point at which that is so), or a time [s]"
    command.add_option("--at", "INSTANT", text, required=True)
    command.add_run()
    command.add_argument(
        "--bode",
        nargs=2,
        type=filled,
        metavar=("INPUT", "OUTPUT"),
        help="of the Bode diagram (default: chaser.force_ext[1] relative.axial)",
    )
    text = "matrices, poles and Bode data; the Bode diagram FILE.png is drawn next to it"
    command.add_output("FILE.json", f"{text} (default: build/results/SCENE/SCENE_linear.json)")
    command.add_flag("--no-plots", "do not draw the Bode diagram")
    command.add_flag("--json", "print the document as JSON")


def run(options: Options) -> None:
    """Linearise, write matrices and figure, say poles."""
    from dockloop.report.linear import report_linear, run_command

    write_found(options, run_command(options), report_linear)
