"""Write the documents that the fuzzing of scenes starts from.

These are the shipped scenes, resolved, a scene of parts, modes, forces and prescribed inputs, a
measured law, the mechanisms of the stored references, and one random mechanism of every kind of
loop and coupling: what the fuzzer then varies. `scripts/fuzz` runs this, with `tests` among the
folders that Python imports from.
"""

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import HealthCheck, Phase, find, settings
from hypothesis.errors import NoSuchExample

from dockloop.base.paths import MECHANISMS, SCENES
from dockloop.scene.resolve import resolve_scene
from random_mechanisms import KINDS, build, plans
from slides import make_element, make_slide, write_slide

TESTS = Path(__file__).resolve().parents[1]
REFERENCES = ("crank_nested", "planar_two_loop", "hexapod_r2p1r3")
VEHICLES = """
outputs.groups = ["relative"]
experiment = {stop = 0.5, step = 0.1}
[chaser]
mass = 1000
inertia = [500, 600, 700, 0, 0, 0]
[[chaser.part]]
mass = 120
joint = "slide"
axis = [1, 0, 0]
frequency = 0.5
damping_ratio = 0.01
coordinate = 0.2
[chaser.adapter]
mass = 10
inertia = [1, 2, 3, 0, 0, 0]
joint = "elastic"
frequency = 8.0
[target]
mass = 9000
inertia = [5000, 6000, 7000, 0, 0, 0]
position = [40, 0, 0]
modes = {frequency = [2.0], participation = [[30, 0, 0, 0, 0, 0]]}
[[input]]
file = "jets.csv"
[[force]]
type = "spring"
stiffness = 3.0
damping = 1.0
free_length = 39.0
target_point = [0, 0.5, 0]
[[force]]
type = "tether"
stiffness = 50.0
free_length = 39.9
toe = 0.01
[[force]]
type = "dipoles"
chaser_moment = [1e5, 2e4, 0]
target_moment = [1e5, 0, 3e4]
size = 0.1
[[force]]
type = "table"
gap = [1, 30, 50]
offset = [0, 1, 2]
force = [[-30, -4, 0], [-20, -3, 0], [-2, -1, 0]]
"""
JETS = "time [s],chaser.force_ext[1] [N]\n0.02,0\n0.035,30\n0.035,12\n0.1,-25\n0.3,0\n"
MEASURED = {
    "type": "table",
    "travel": [-0.2, -0.05, 0.1],
    "rates": [-0.5, 0.0, 1.0],
    "force": [[820, 220, -380], [800, 200, -400], [760, 160, -440]],
    "outside": "extend",
}
LONGEST = 12000  # characters of a document; longer ones only make the fuzzer slow


def find_random_mechanism(kind: str) -> dict | None:
    """The smallest mechanism with a loop of a kind, without the states to evaluate."""
    quick = settings(
        max_examples=50,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    try:
        plan = find(plans(kind), lambda plan: build(plan) is not None, settings=quick)
    except NoSuchExample:
        return None
    return build(plan)[0]["mechanism"]


def make_vehicles(folder: Path) -> dict:
    """A resolved scene with parts, an adapter, modes, forces and inputs; writes its files."""
    (folder / "jets.csv").write_text(JETS)
    (folder / "vehicles.toml").write_text(VEHICLES)
    return resolve_scene(folder / "vehicles.toml")


def make_measured_slide(folder: Path) -> dict:
    """A resolved scene of a body on a slide with a law from a table; writes its files."""
    scene = write_slide(folder, make_slide(40.0, make_element(MEASURED)), 0.3)
    return resolve_scene(Path(scene))


def make_seeds() -> dict[str, dict]:
    """Documents by file name."""
    with TemporaryDirectory() as folder:
        own = [make(Path(folder)) for make in (make_vehicles, make_measured_slide)]
    seeds = dict(zip(("vehicles", "measured_slide"), own, strict=True))
    seeds |= {f"scene_{path.stem}": resolve_scene(path) for path in SCENES.glob("*.toml")}
    for path in (*MECHANISMS.glob("*.json"), *(TESTS / "data").glob("scene_*.json")):
        seeds[path.stem] = json.loads(path.read_text())
    for name in REFERENCES:
        document = json.loads((TESTS / "data" / f"{name}.json").read_text())
        seeds[name] = {key: document[key] for key in ("mechanism", "home_q") if key in document}
    for kind in KINDS:
        seeds[f"random_{kind}"] = find_random_mechanism(kind)
    return {name: document for name, document in seeds.items() if document}


def main() -> None:
    """Write every document into the folder given."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, document in make_seeds().items():
        text = json.dumps(document, separators=(",", ":"))
        if len(text) <= LONGEST:
            (folder / f"{name}.json").write_text(text)


if __name__ == "__main__":
    main()
