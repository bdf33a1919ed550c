"""``dockloop compare``: measured time histories over a run."""

from dockloop.arguments import Command, Options, file_path, finite
from dockloop.console import write_found

EXAMPLE = "example: dockloop compare build/results/absorber_1d/absorber_1d.csv rig.csv"
_BAND = 0.10


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "result", type=file_path, metavar="RESULT", help="result of a run (.csv, .npz or .parquet)"
    )
    command.add_argument(
        "data",
        type=file_path,
        metavar="DATA.csv",
        help="measurements; header: output, unit, accuracy: time [s],relative.axial [mm] +-1,...",
    )
    text = "time of the run less time of the data [s] (default: found from the columns)"
    command.add_option("--shift", "T", text, type=finite)
    text = f"half width of the error band, as part of the measured range (default: {_BAND:g})"
    command.add_option("--band", "PART", text, type=finite, default=_BAND)
    text = "what became of the measured docking: captured, rebound, miss, ..."
    command.add_option("--outcome", "NAME", text)
    text = "numbers; the figure FILE.png is written next to them (default: RESULT_compared.json)"
    command.add_output("FILE.json", text)
    command.add_flag("--no-plots", "do not draw the figure")
    command.add_flag("--json", "print the numbers as JSON")


def run(options: Options) -> None:
    """Compare, write numbers and figure."""
    from dockloop.measured.command import describe, run_command

    write_found(options, run_command(options), describe)
