"""Write the documents that the fuzzing of scenes starts from.

These are the shipped scenes, resolved, the mechanisms of the stored references, and one random
mechanism of every kind of loop and coupling: what the fuzzer then varies. `scripts/fuzz` runs this,
with `tests` among the folders that Python imports from.
"""

import json
import sys
from pathlib import Path

from hypothesis import HealthCheck, Phase, find, settings
from hypothesis.errors import NoSuchExample

from dockloop.base.paths import MECHANISMS, SCENES
from dockloop.scene.resolve import resolve_scene
from random_mechanisms import KINDS, build, plans

TESTS = Path(__file__).resolve().parents[1]
REFERENCES = ("crank_nested", "planar_two_loop", "hexapod_r2p1r3")
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


def make_seeds() -> dict[str, dict]:
    """Documents by file name."""
    seeds = {f"scene_{path.stem}": resolve_scene(path) for path in SCENES.glob("*.toml")}
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
