"""``dockloop compare``: measured time histories over a run."""

from dockloop.commands.arguments import Command, Options, file_path, finite
from dockloop.commands.console import write_found

EXAMPLE = "example: dockloop compare build/results/absorber_1d/absorber_1d.csv rig.csv"
_BAND = 0.10


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    text = "result of a run (.csv, .npz, .parquet or .h5)"
    command.add_argument("result", type=file_path, metavar="RESULT", help=text)
    command.add_argument(
        "data",
        type=file_path,
        metavar="DATA",
        help="measurements: CSV, Excel, Parquet, NPZ, MAT or HDF5; header: output, unit, accuracy:"
        " time [s],relative.axial [mm] +-1,...",
    )
    text = "what columns mean: 'Fz=capture.compression:kN, dx=relative.axial:mm', or a TOML file"
    command.add_list("--columns", "columns", "NAME=OUTPUT:UNIT", text)
    text = "form of a table, where it is not found: sep, decimal, encoding, comment, header,"
    command.add_option("--csv", "TEXT", f"{text} units, date, sheet: 'sep=;, decimal=,'")
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
    from dockloop.studies.measured.command import report_comparison, run_command

    write_found(options, run_command(options), report_comparison)
