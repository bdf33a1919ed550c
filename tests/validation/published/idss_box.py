"""Case H: capture and loads inside the box of the IDSS, for every ring, with and without thrust.

Conditions that are vector sums are drawn from discs. All limits hold at the same time.
"""

import tomllib

import numpy as np
from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_words

import dockloop as dl
from dockloop.base import paths

COUNT, END = 16, 12.0  # dockings of a row, s
THRUST = {"chaser.contact_thrust": 800.0, "chaser.contact_thrust_delay": 0.3}
SOFT = {  # a quarter of the shipped ones [N/m]
    "mechanism.set.contact.law.stiffness": 5e5,
    "mechanism.set.contact.law.node_stiffness": 5e5 / 12.0,
}
ROWS = [
    (f"{scene}, {name}", scene, thrust)
    for scene in ("apda", "hexapod", "idss_25t_350t")
    for name, thrust in (("no thrust", {}), ("800 N after 0.3 s", THRUST))
] + [
    ("apda, contact of a quarter of the stiffness, no thrust", "apda", SOFT),
    ("the same, 800 N after 0.3 s", "apda", SOFT | THRUST),
]

REASON = (
    "the stiffness of the contact and the springs of the tilts decide most about the compression"
    " (parameters.md); these and the rated compression are assumed"
)


def run_box(scene: str, values: dict[str, float]):
    """Return the table of the dockings of one row."""
    file = paths.SWEEPS / "idss_initial_conditions.toml"
    sweep = tomllib.loads(file.read_text(encoding="utf-8"))
    sweep |= {"scene": scene, "cases": COUNT, "experiment": {"stop": END, "step": 0.25}}
    sweep["set"] = sweep["set"] | values
    return dl.sweep(sweep)


def report() -> list[Comparison]:
    """Rates of capture, and the largest share of a rated load."""
    rows = []
    for what, scene, values in ROWS:
        table = run_box(scene, values)
        captured = int((table["outcome"] == "captured").sum())
        share = table["capture.peak.load_ratio"].to_numpy(dtype=float)
        found = (
            f"{captured} of {len(table)} captured; share of rated loads: median"
            f" {np.median(share):.2f}, largest {share.max():.2f}"
        )
        agrees = captured == len(table) and share.max() <= 1.0
        reason = REASON if scene == "apda" else ""
        rows.append(compare_words(what, found, "all captured, loads below rating", agrees, reason))
    return rows


CASE = Case(
    "H",
    "Box of initial conditions of the IDSS",
    "IDSS Interface Definition Document (transcriptions)",
    (
        Input("limits of the box", "file idss_initial_conditions", GIVEN),
        Input("rated tension, bending", "3.9 kN, 2.8 kN m", GIVEN),
        Input("rated compression, shear, torsion", "3.5 kN, 3.2 kN, 1.5 kN m", ASSUMED),
        Input("dockings of a row", f"{COUNT}, of {END:g} s", ASSUMED),
    ),
    "A requirement, and no measurement: the table shows how fit the shipped rings are, and"
    " validates nothing. With few dockings a row, a rate of capture is known to about 10 %.",
    scenario=report,
)  # fmt: skip
