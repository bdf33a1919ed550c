"""The six maps that are shipped: where the default docking is right, refused or wrong.

Runs `dockloop map` for each, keeps journals in build/maps, and writes pages, pictures and tables
into tests/validation/maps, with an overview in tests/validation/maps.md.

Examples:
    .venv/bin/python tests/studies/maps.py                         # some minutes of two processors
    .venv/bin/python tests/studies/maps.py --only wrong_mass_and_step --points 9
    .venv/bin/python tests/studies/maps.py --resume                # after Ctrl-C
"""

import argparse
import json
import shutil
import sys

from dockloop import cli
from dockloop.base.paths import BUILD, ROOT
from dockloop.runs.judging import VERDICTS
from page import write_page, write_table

SCENE = ("idss_25t_350t", "--scene", "initial.approach_time=0.2")
FOLDER = ROOT / "tests" / "validation" / "maps"
PAGE = FOLDER.with_suffix(".md")
SHIPPED = ("map.md", "map.png", "points.csv")
STEP = ("--y", "experiment.step", "1e-4", "1")
STIFFNESS = ("contact.stiffness", "1e4", "1e10")
DAMPING = ("mechanism.set.leg_defaults.damping", "10", "1e6")
MAPS = {  # folder: what it shows, arguments
    "stiffness_and_step": (
        "contact stiffness and communication step",
        ("--x", *STIFFNESS, *STEP, "--stop", "1.5"),
    ),
    "mass_and_stiffness": (
        "mass of the chaser and contact stiffness",
        ("--x", "chaser.mass", "1e2", "1e7", "--y", *STIFFNESS, "--stop", "1.5"),
    ),
    "speed_and_tolerance": (
        "closing speed and relative tolerance",
        (
            *("--x", "initial.closing_speed", "1e-3", "2"),
            *("--y", "solver.rtol", "1e-12", "1e-2", "--stop", "1.5"),
        ),
    ),
    "wrong_mass_and_step": (
        "a vehicle of 25 t in the host, the mass that the FMU receives, and communication step",
        (
            *("--x", "chaser.mass", "2.5e3", "2.5e5"),
            *("--y", "experiment.step", "1e-3", "0.3", "--host", "chaser", "--stop", "4"),
        ),
    ),
    "friction_speed_and_step": (
        "friction speed and communication step",
        ("--x", "contact.friction_speed", "1e-7", "1e-1", *STEP, "--stop", "1.5"),
    ),
    "damping_and_fixed_step": (
        "leg damping and inner step of fixed_rk4",
        (
            *("--x", *DAMPING, "--y", "solver.step", "1e-4", "1e-1"),
            *("--set", "solver.method=fixed_rk4", "--stop", "1.5"),
        ),
    ),
}

POINTS = 17  # along a range


def make_map(name, arguments, options):
    """Make one map and ship its files."""
    folder = BUILD / "maps" / name
    points = str(options.points)
    words = ["map", *SCENE, *arguments, "--points", points, "-o", str(folder)]
    if cli.main([*words, *["--resume"] * options.resume]) != 0:
        sys.exit(f"{name}: no map")
    (FOLDER / name).mkdir(parents=True, exist_ok=True)
    for file in SHIPPED:
        shutil.copyfile(folder / file, FOLDER / name / file)


def read_summary(name):
    """Return the summary of a map that was made."""
    return json.loads((BUILD / "maps" / name / "summary.json").read_text())


def describe(name, about, summary):
    """Return the lines of one map on the overview."""
    parts = [
        f"{summary['parts'][verdict][0]:.0%} {verdict}"
        for verdict in VERDICTS
        if verdict in summary["parts"]
    ]
    count = {verdict: summary["verdicts"][verdict] for verdict in VERDICTS}
    bad = count["wrong"] + count["hung"] + count["crashed"]
    largest = summary["largest_error_of_right"]
    return (
        f"[{about}](maps/{name}/map.md)",
        summary["points"],
        ", ".join(parts),
        bad,
        f"{largest:.0e}",
        summary["right_by_audits_only"],
    )


def main():
    """Make the maps and the overview."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--points", type=int, default=POINTS, help="along a range")
    parser.add_argument("--only", choices=MAPS, help="one map; the overview is not written")
    parser.add_argument("--resume", action="store_true", help="go on with the journals")
    parser.add_argument("--overview", action="store_true", help="of the maps that are there")
    options = parser.parse_args()
    for name, (_, arguments) in MAPS.items():
        if not options.overview and options.only in (None, name):
            make_map(name, arguments, options)
    if options.only is None:
        head = ("over", "points", "part of the plane", "bad points")
        rows = [describe(n, about, read_summary(n)) for n, (about, _) in MAPS.items()]
        pictures = [f"![{about}](maps/{n}/map.png)" for n, (about, _) in MAPS.items()]
        write_page(
            PAGE,
            "Where the default docking holds",
            "tests/studies/maps.py",
            "Maps of `dockloop map`: first contact after 0.2 s, error up to 1e-2, bad: wrong, hung"
            " or crashed. Each page has reasons, commands and a table of all points.",
            write_table((*head, "largest error of right points", "right by audits only"), rows),
            pictures,
        )


if __name__ == "__main__":
    main()
