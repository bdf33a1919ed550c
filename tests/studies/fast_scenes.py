"""Do outcomes depend on the communication step? Random fast dockings: tests/validation/steps.md.

Vehicles meet at 0.5 to 2 m/s, up to 0.3 m off each other sideways, spinning with up to 60 rpm, at
the default tolerances. Every scene runs with communication steps of 0.02 and of 0.1 s; outcome and
every latch must be the same. Light vehicles rebound; heavy ones often press the surfaces to their
cores, which is refused.

Examples:
    .venv/bin/python tests/studies/fast_scenes.py                # half an hour on two cores
    .venv/bin/python tests/studies/fast_scenes.py --cases 64     # a minute
"""

import collections
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dockloop.base import paths
from dockloop.base.progress import ProgressBar
from dockloop.sweeps.run import run_sweep
from dockloop.sweeps.sampling import read_sweep
from light_vehicles import write_light_scene
from page import Table, make_parser, write_page, write_points

PAGE = paths.ROOT / "tests" / "validation" / "steps.md"
STEPS = (0.02, 0.1)
COMPARED = ("outcome", "latched[1]", "latched[2]", "latched[3]")
VEHICLES = {  # name: are they light, part of the scenes
    "chaser of 400 kg, target of 800 kg": (True, 1),
    "the default vehicles, 25 t and 350 t": (False, 4),  # take longer
}
REASONS = {  # part of the sentence: in short
    "no free motion": "no free motion leads to these conditions at first contact",
    "pressed together": "surfaces are pressed to their cores",
    "pass through": "surfaces would pass through each other",
    "the step needs more": "a step would take more work than it may",
}
SWEEP = """
scene = "{scene}"
seed = 7
cases = {cases}
sampling = "sobol"
outcomes = ["outcome", "latched[1]", "latched[2]", "latched[3]", "time_of_capture"]
[set]
"initial.approach_time" = 0.05
[[vary]]
type = "uniform"
name = "initial.closing_speed"
range = [0.5, 2.0]
[[vary]]
type = "disc"
magnitude = "initial.lateral_offset"
direction = "initial.lateral_direction_deg"
range = [0.0, 0.30]
[[vary]]
type = "disc"
magnitude = "initial.lateral_speed"
direction = "initial.lateral_speed_direction_deg"
range = [0.0, 0.2]
[[vary]]
type = "disc"
magnitude = "initial.pitch_yaw_deg"
direction = "initial.pitch_yaw_direction_deg"
range = [0.0, 6.0]
[[vary]]
type = "uniform"
name = "initial.roll_deg"
range = [-10.0, 10.0]
[[vary]]
type = "uniform"
name = "initial.roll_rate_deg_s"
range = [-360.0, 360.0]
[experiment]
stop = 1.2
step = {step}
"""


def run(folder: Path, scene: str, cases: int, step: float) -> list:
    """Run one sweep; returns its results, one a case."""
    file = folder / f"step_{step}.toml"
    file.write_text(SWEEP.format(scene=scene, cases=cases, step=step), encoding="utf-8")
    output, label = file.with_suffix(".parquet"), f"steps of {step} s"
    return list(run_sweep(read_sweep(str(file)), output, progress=ProgressBar(label))["results"])


def compare(cases: int, *, light: bool) -> tuple[list[int], str]:
    """Run all scenes with both steps; returns counts and why scenes were not run to the end."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = write_light_scene(folder).name if light else "idss_25t_350t"
        fine, coarse = (run(folder, scene, cases, step) for step in STEPS)
    both = [(a, b) for a, b in zip(fine, coarse, strict=True) if a.status == b.status == "done"]
    ended = [a.outputs[: len(COMPARED)] != b.outputs[: len(COMPARED)] for a, b in both]
    apart = sum(
        (a.status == "done") != (b.status == "done") for a, b in zip(fine, coarse, strict=True)
    )
    caught = sum(any(a.outputs[1 : len(COMPARED)]) for a, _ in both)
    reasons = collections.Counter(
        next((why for part, why in REASONS.items() if part in a.reason), a.reason)
        for a in fine
        if a.status != "done"
    )
    points = (f"{count}: {reason}" for reason, count in reasons.most_common())
    return [len(both), caught, sum(ended), apart], write_points(points) or "* none"


def main() -> None:
    """Write the page."""
    parser = make_parser(__doc__, PAGE)
    parser.add_argument("--cases", type=int, default=2048, help="scenes: a power of two")
    options = parser.parse_args()
    table = Table(
        *("vehicles", "scenes", "run to the end with both steps", "with a latch that caught"),
        *("other outcome or latches", "run to the end with one step only"),
    )
    notes = []
    for name, (light, part) in VEHICLES.items():
        cases = options.cases // part
        counts, reasons = compare(cases, light=light)
        table.add(name, cases, *counts)
        notes += [f"Not run to the end with steps of {STEPS[0]} s, {name}:", reasons]
    write_page(
        options.output,
        "Outcomes and the communication step",
        f"tests/studies/fast_scenes.py --cases {options.cases}",
        f"Random scenes of 1.2 s, default tolerances, communication steps of {STEPS[0]} and"
        f" {STEPS[1]} s: closing speed 0.5 to 2 m/s, offset up to 0.3 m, spin up to 60 rpm.",
        table,
        notes,
    )


if __name__ == "__main__":
    main()
