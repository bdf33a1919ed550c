"""``dockloop fit``: parameters from measurements, with their uncertainty."""

from dockloop.commands.arguments import Command, Options, file_path, filled, finite, positive, whole
from dockloop.commands.console import write_found

EXAMPLE = (
    "example: dockloop fit absorber_1d rig.csv --vary mechanism.set.contact.damping 2e3 4e4"
    " --vary mechanism.set.contact.stiffness 1e4 3e4"
)


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_scene()
    text = "tests: tables as those of 'compare', or TOML lists of tests with what each one sets"
    command.add_argument("data", type=file_path, nargs="+", metavar="DATA", help=text)
    for option, member, text in (
        ("--vary", "vary", "what is fitted: a key of the scene or an FMU variable (repeatable)"),
        ("--vary-each", "vary_each", "the same, but each test has a value of its own"),
    ):
        command.add_argument(
            option, dest=member, nargs=3, type=filled, action="append", default=[],
            metavar=("NAME", "LOW", "HIGH"), help=text,
        )  # fmt: skip
    text = "what columns mean: 'Fz=capture.compression:kN, dx=relative.axial:mm', or a TOML file"
    command.add_list("--columns", "columns", "NAME=OUTPUT:UNIT", text)
    command.add_option("--csv", "TEXT", "form of the tables, as for 'compare': 'sep=;, decimal=,'")
    text = "standard deviation of a channel in the unit of its output (default: estimated)"
    command.add_list("--noise", "noise", "OUTPUT=SIGMA", text)
    text = "corner frequency of a sensor that is a first-order low-pass [Hz]"
    command.add_list("--filter", "filters", "OUTPUT=HZ", text)
    text = "largest change within a second that a sensor follows, in the unit of its output"
    command.add_list("--rate-limit", "rate_limits", "OUTPUT=RATE", text)
    for option in ("offset", "scale"):
        text = f"a channel with an unknown {option} in each test"
        command.add_list(f"--{option}", f"{option}s", "OUTPUT", text)
    text = "time of the run less time of the data [s] (default: unknown in each test)"
    command.add_option("--shift", "T", text, type=finite)
    text = "linear, or soft_l1 against outliers (default: linear)"
    command.add_option("--loss", "NAME", text, default="linear")
    text = "most starts of the search; all but one are for a result in doubt (default: 8)"
    command.add_option("--starts", "N", text, type=whole, default=8)
    command.add_option("--seed", "N", "of these (default: 0)", type=whole, default=0)
    text = "hold one of the worst pair of parameters at other values, and fit all others again"
    command.add_flag("--profile", text)
    command.add_flag(
        "--plan",
        "before measuring: which test of the lists DATA would say most about which parameter",
    )
    command.add_run()
    text = "wanted relative error of the runs (default: 1e-6)"
    command.add_option("--accuracy", "ERROR", text, type=finite)
    command.add_executor()
    command.add_flag("--resume", "go on after Ctrl-C or a crash with the runs that are there")
    text = "write a copy of the scene with the fitted numbers"
    command.add_option("--apply", "FILE.toml", text, type=file_path)
    text = "write FILE_cases.csv: N cases for a sweep, drawn with the covariance of the parameters"
    command.add_option("--cases", "N", text, type=positive)
    command.add_output(
        "FILE.json", "all numbers; figure and journal are next to it (default: build/fits/SCENE)"
    )
    command.add_flag("--no-plots", "do not draw the figure")
    command.add_report("FILE_report.html")
    command.add_flag("--json", "print the numbers as JSON")


def run(options: Options) -> None:
    """Fit or plan; write numbers, figure, page, copy."""
    from dockloop.studies.fits.command import run_command
    from dockloop.studies.fits.report import report_fit

    write_found(options, run_command(options), report_fit)
