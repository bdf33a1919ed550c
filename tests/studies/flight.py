"""What a long approach costs, and whether results show that the mechanism rested meanwhile.

Flies ten minutes to the default docking with the mechanism at rest far from contact
(``model.flight`` 1) and always integrated (2), at several communication steps. Written to
tests/validation/flight.md: the share of the free drift in all evaluations and in the time inside
``fmi2DoStep``, and how far the docking that follows is from the same docking integrated at 1e-10.

    .venv/bin/python tests/studies/flight.py            # about a minute
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dockloop.base.paths import ROOT
from dockloop.fmu.build import build_fmu
from dockloop.native.core import list_loads
from extreme_cases.fmi_host import Host
from page import Table, write_page

DRIFT, DOCKING = 600.0, 20.0  # s
TIGHT = {"solver__rtol": 1e-10, "solver__atol_position": 1e-12, "solver__atol_velocity": 1e-12}
GROUPS = 'outputs.groups=["relative", "capture", "phase", "ring", "solver"]'
LOADS = [f"capture.peak.{load}" for load in list_loads()]
MOTION = [f"relative.{n}[{i}]" for n in ("position", "velocity") for i in (1, 2, 3)]


def run(fmu, drift, size, **values):
    """One approach and docking: loads, times, motion, cost in free drift and in all."""
    with Host(fmu) as host:
        host.choose(model__flight=drift)
        host.set(**values)
        host.start()
        cost = []
        begin = time.perf_counter()
        for end in (DRIFT - 1.0, DRIFT + DOCKING):
            count = round((end - host.time) / size)
            for _ in range(count):
                host.slave.doStep(host.time, size)
                host.time += size
            cost.append((host.value("solver.rhs_evaluations"), time.perf_counter() - begin))
        times = host.get("time_of_contact", "time_of_capture")
        return host.get(*LOADS), times, host.get(*MOTION), cost


def main():
    """Write the page."""
    table = Table(
        *("mechanism", "step s", "evaluations in free drift / all", "share", "share of time"),
        *("peak loads off by", "times s", "motion m, m/s"),
    )
    with tempfile.TemporaryDirectory() as folder:
        overrides = (f"initial.approach_time={DRIFT}", GROUPS)
        fmu = build_fmu("idss_25t_350t", overrides, Path(folder) / "approach.fmu", bare=True)
        exact = run(fmu, 2, 1.0, **TIGHT)
        for name, drift, size in (
            ("integrated", 2, 1.0),
            ("quiescent", 1, 1.0),
            ("integrated", 2, 0.1),
            ("quiescent", 1, 0.1),
            ("quiescent", 1, 0.01),
        ):
            loads, times, motion, cost = run(fmu, drift, size)
            (before, seconds), (total, total_seconds) = cost
            table.add(
                *(name, f"{size:g}", f"{before:.0f} / {total:.0f}", f"{before / total:.2%}"),
                f"{seconds / total_seconds:.1%}",
                f"{np.abs(loads - exact[0]).max() / exact[0].max():.0e}",
                f"{np.abs(times - exact[1]).max():.0e}",
                f"{np.abs(motion - exact[2]).max():.0e}",
            )
    write_page(
        ROOT / "tests" / "validation" / "flight.md",
        "A long approach with the mechanism at rest",
        "tests/studies/flight.py",
        "Ten minutes of approach and 20 s of the default docking; quiescent: `model.flight` 1, the"
        " default. Errors are those against a run that is always integrated, at 1e-10.",
        table,
    )


if __name__ == "__main__":
    main()
