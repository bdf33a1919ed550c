"""Arguments of ``dockloop view``, in a module that loads quickly."""

import argparse
from pathlib import Path

EXAMPLE = "example: dockloop view build/results/idss_25t_350t/idss_25t_350t.csv -o docking.html"
CAMERAS = ("oblique", "side", "front", "axis", "ring", "vehicles")


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "result",
        metavar="RESULT",
        help="result of a run (.csv, .npz, .parquet), table of a sweep (.parquet; a case is run"
        " again), or FMU with a --state",
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="page .html, still .png, film .mp4 (default: RESULT_view.html next to the result);"
        " several cases of a sweep: FILE_caseN",
    )
    command.add_argument(
        "--model",
        metavar="SCENE|FILE.fmu",
        help="what made the result (default: the summary next to the result says it)",
    )
    command.add_argument(
        "--state",
        type=Path,
        metavar="FILE",
        help="of an FMU: this saved state, the bytes of fmi2SerializeFMUstate",
    )
    command.add_argument(
        "--mesh",
        dest="meshes",
        action="append",
        default=[],
        metavar="VEHICLE=FILE.stl",
        help="draw chaser or target so: metres, axes and origin of its body frame (repeatable)",
    )
    command.add_argument(
        "--case",
        dest="cases",
        action="append",
        type=int,
        default=[],
        metavar="N",
        help="of a sweep: this case (repeatable; default: the worst one)",
    )
    command.add_argument(
        "--not-captured",
        type=int,
        metavar="N",
        help="of a sweep: the first N cases that were not captured",
    )
    command.add_argument(
        "--still",
        metavar="T,...",
        help="pictures at these times [s] or events: start, contact, capture, peak, end;"
        " with -o FILE.png (several: FILE_1.png, FILE_2.png); needs Chromium",
    )
    command.add_argument(
        "--film", action="store_true", help="a film, with -o FILE.mp4; needs Chromium and ffmpeg"
    )
    command.add_argument(
        "--from", dest="begin", type=float, metavar="T", help="begin of a film [s]"
    )
    command.add_argument("--to", dest="end", type=float, metavar="T", help="end of a film [s]")
    command.add_argument(
        "--speed",
        type=float,
        default=1.0,
        metavar="X",
        help="seconds of the docking in a second of a film (default: 1)",
    )
    command.add_argument(
        "--camera",
        choices=CAMERAS,
        default="oblique",
        help="of stills and films (default: oblique)",
    )
    command.add_argument(
        "--size", default="1280x800", metavar="WxH", help="of stills and films (default: 1280x800)"
    )
