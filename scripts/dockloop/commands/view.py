"""``dockloop view``: the motion in three dimensions."""

from dockloop.commands.arguments import Command, Options, file_path, filled, finite, whole
from dockloop.commands.console import write

EXAMPLE = "example: dockloop view build/results/idss_25t_350t/idss_25t_350t.csv -o docking.html"


def add_options(command: Command) -> None:
    """Describe the arguments of the command."""
    command.add_argument(
        "result",
        type=filled,
        metavar="RESULT",
        help="result of a run (.csv, .npz, .parquet), table of a sweep (.parquet; a case is run"
        " again), or FMU with a --state",
    )
    command.add_output(
        "FILE",
        "page .html, still .png, film .mp4 (default: RESULT_view.html next to the result);"
        " several cases of a sweep: FILE_caseN",
    )
    text = "what made the result (default: the summary next to the result says it)"
    command.add_option("--model", "SCENE|FILE.fmu", text)
    text = "of an FMU: this saved state, the bytes of fmi2SerializeFMUstate"
    command.add_option("--state", "FILE", text, type=file_path)
    text = (
        "draw chaser, target or a body of the mechanism so: STL, or OBJ or glTF (needs"
        " dockloop[meshes]); metres, axes and origin of its body frame, else @SCALE or"
        " @x,y,z,qw,qx,qy,qz,SCALE follows (repeatable)"
    )
    command.add_list("--mesh", "meshes", "NAME=FILE", text)
    text = "of a sweep: this case (repeatable; default: the worst one)"
    command.add_list("--case", "cases", "N", text, type=whole)
    text = "of a sweep: the first N cases that were not captured"
    command.add_option("--not-captured", "N", text, type=whole)
    command.add_option(
        "--still",
        "T,...",
        "pictures at these times [s] or events: start, contact, capture, peak, end;"
        " with -o FILE.png (several: FILE_1.png, FILE_2.png); needs Chromium",
    )
    command.add_flag("--film", "a film, with -o FILE.mp4; needs Chromium and ffmpeg")
    command.add_option("--from", "T", "begin of a film [s]", dest="begin", type=finite)
    command.add_option("--to", "T", "end of a film [s]", dest="end", type=finite)
    text = "seconds of the docking in a second of a film (default: 1)"
    command.add_option("--speed", "X", text, type=finite)
    command.add_argument(
        "--camera",
        choices=("oblique", "side", "front", "axis", "ring", "vehicles"),
        help="of stills and films (default: oblique)",
    )
    text = "of stills and films (default: 1280x800)"
    command.add_option("--size", "WxH", text)


def run(options: Options) -> None:
    """Write the page, stills or a film."""
    from dockloop.view.command import view

    write(view(options))
