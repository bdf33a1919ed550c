"""``dockloop review``: one docking for a review board, as a page and as a PDF."""

from dockloop.commands.arguments import Command, Options, finite, whole
from dockloop.commands.console import write_found

EXAMPLE = "example: dockloop review absorber_1d --stop 3 --no-pdf"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    command.add_run()
    command.add_accuracy()
    for letter in "xy":
        command.add_range(letter, is_optional=True)
    command.add_list(
        "--criterion",
        "criterion",
        "TEXT",
        "what a docking must meet, as for dockloop envelope (default: captured and load_ratio < 1;"
        " repeatable)",
    )
    text = "the boundary is found within this part of each range (default: 0.03)"
    command.add_option("--tolerance", "PART", text, type=finite, default=0.03)
    text = "directions of the first start condition that has one (default: 12; 1: as in the scene)"
    command.add_option("--directions", "N", text, type=whole, default=12)
    text = "show how uncertain loads and boundary are with the parameters of a fit"
    command.add_fitted(text)
    text = "dockings with parameters of the fit (default: 32)"
    command.add_option("--cases", "N", text, type=whole, default=32)
    command.add_workers()
    command.add_flag("--no-pdf", "write the page only")
    text = "for page, PDF, figures and summary (default: build/reviews/SCENE)"
    command.add_output("FOLDER", text)
    command.add_flag("--json", "print the summary as JSON")


def run(options: Options) -> None:
    """Make the report."""
    from dockloop.review.command import CRITERION, report_review, run_command

    options.criterion = options.criterion or [CRITERION]
    write_found(options, run_command(options), report_review)
