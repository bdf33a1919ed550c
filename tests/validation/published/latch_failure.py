"""Case M: a probe whose pawls never seat, and loads of a light docking."""

from case import ASSUMED, GIVEN, Case, Comparison, Input, compare_words

import dockloop as dl

THRUST, HELD, LAST = 400.0, 4.0, 1.0  # N, s, s


def run_failure() -> dl.Result:
    """Run the shipped probe with pawls that no striker comes near enough to, under thrust."""
    start = {"chaser.contact_thrust": THRUST}
    failed = {"mechanism.set.latches.window": 1e-6}
    return dl.run("probe_drogue", failed | start, stop=2.0 + HELD, step=0.05)


def report() -> list[Comparison]:
    """No capture, contact that lasts while the thrust does, and the sentence about it."""
    run = run_failure()
    held = float(run["capture.compression"][run.time > run.time[-1] - LAST].mean())
    return [
        compare_words(
            f"pawls never seat, {THRUST:.0f} N held for {HELD:g} s",
            run.summary["explanation"],
            "not captured",
            not run["captured"].any(),
        ),
        compare_words(
            f"mean compression of the last {LAST:g} s",
            f"{held:.0f} N",
            "above 0: the thrust keeps the head pressed",
            held > 0.0,
        ),
    ]


CASE = Case(
    "M",
    "Latch never seats",
    "Apollo 14 (NASA SP-4209); Syromiatnikov, page 28",
    (
        Input("six attempts, held thrust of four seconds did not latch", "story", GIVEN),
        Input("failure", "window of the pawls 1 um", ASSUMED),
        Input("thrust", f"{THRUST:.0f} N", ASSUMED),
    ),
    "A failure to run, and no number to compare. The summary of a run states the reason in a"
    " sentence. A published port for small satellites stays below 3 N at up to 5 deg and 15 mm; its"
    " masses and speed are missing, so it is not run.",
    scenario=report,
)
