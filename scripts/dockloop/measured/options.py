"""Arguments of ``dockloop compare``, in a module that loads quickly."""

import argparse
from pathlib import Path

EXAMPLE = "example: dockloop compare build/results/absorber_1d/absorber_1d.csv rig.csv"
BAND = 0.10


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "result", type=Path, metavar="RESULT", help="result of a run (.csv, .npz or .parquet)"
    )
    command.add_argument(
        "data",
        type=Path,
        metavar="DATA.csv",
        help="measurements; the header names outputs with units: time [s],relative.axial [mm],...",
    )
    command.add_argument(
        "--shift",
        type=float,
        metavar="T",
        help="time of the run less time of the data [s] (default: found from the columns)",
    )
    command.add_argument(
        "--band",
        type=float,
        default=BAND,
        metavar="PART",
        help=f"half width of the error band, as part of the measured peak (default: {BAND:g})",
    )
    command.add_argument(
        "--outcome",
        metavar="NAME",
        help="what became of the measured docking: captured, rebound, miss, ...",
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE.json",
        help="numbers; the figure FILE.png is written next to them (default: RESULT_compared.json)",
    )
    command.add_argument("--no-plots", action="store_true", help="do not draw the figure")
    command.add_argument("--json", action="store_true", help="print the numbers as JSON")
