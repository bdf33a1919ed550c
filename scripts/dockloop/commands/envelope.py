"""``dockloop envelope``: the boundary of a criterion."""

from dockloop.commands.arguments import Command, Options, finite, whole
from dockloop.commands.console import write_found

EXAMPLE = (
    "example: dockloop envelope absorber_1d --x initial.closing_speed 0.05 0.15"
    ' --y chaser.mass 20e3 30e3 --criterion "capture.peak.compression < 1500"'
)


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    for letter in "xyz":
        command.add_range(letter, is_optional=letter == "z")
    command.add_list(
        "--criterion",
        "criteria",
        "TEXT",
        'a condition, e.g. "captured within 5 s and load_ratio < 1": captured, contact, rebound,'
        " miss; comparisons of outputs at the end, of peak loads (compression, ..., load_ratio) and"
        " of what varies; and, or, not. 'within' counts from first contact (repeatable: same"
        " dockings)",
        required=True,
    )
    text = "these quantities in equal ratios, e.g. --log xy"
    command.add_option("--log", "xyz", text)
    text = "the boundary is found within this part of each range (default: 0.01; 0.04 with --z)"
    command.add_option("--tolerance", "PART", text, type=finite)
    command.add_option(
        "--coarse",
        "N",
        "cells along a range at the beginning; what is smaller may be missed (default: 8; 4"
        " with --z)",
        type=whole,
    )
    text = "dockings at random away from the boundary, to find what was missed (default: 16)"
    command.add_option("--check", "N", text, type=whole, default=16)
    text = "of these, and of --draws (default: 0)"
    command.add_option("--seed", "N", text, type=whole, default=0)
    text = "find the boundary with the values of a fit, then with draws of them: its band"
    command.add_fitted(text)
    text = "searches of the band of --from (default: 8)"
    command.add_option("--draws", "N", text, type=whole, default=8)
    command.add_run()
    command.add_accuracy()
    command.add_assured()
    command.add_executor()
    command.add_flag(
        "--resume",
        "go on with the dockings that are there: after Ctrl-C, with other criteria, ranges, or"
        " a smaller tolerance",
    )
    text = "for tables, figure, summary and journal (default: build/envelopes/SCENE)"
    command.add_output("FOLDER", text)
    command.add_flag("--no-plots", "do not draw the figure")
    command.add_report("report.html")
    command.add_flag("--json", "print the summary as JSON")


def run(options: Options) -> None:
    """Find the boundary: dockings, tables, summary, figure."""
    from dockloop.studies.envelopes.command import run_command
    from dockloop.studies.envelopes.report import report_envelope

    write_found(options, run_command(options), report_envelope)
