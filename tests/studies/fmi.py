"""Writes how well both interfaces and the derivatives of the FMU agree: tests/validation/fmi.md.

1. Model exchange, integrated by FMPy's CVODE, against co-simulation at tight tolerance.
2. Directional derivatives against central differences of sixth order through the interface, all
   declared pairs.

Example:
    .venv/bin/python tests/studies/fmi.py
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import test_derivatives as derivatives
import test_model_exchange as exchange
from dockloop.base.paths import ROOT
from dockloop.fmu.build import build_fmu
from page import Table, write_page

TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-10)


def list_exchange(folder):
    """One row per scene and tolerance of CVODE."""
    table = Table("scene", "tolerance of CVODE", "pose", "time of contact, of capture")
    for scene, (overrides, stop, pose, times, _) in exchange.SCENES.items():
        fmu = build_fmu(scene, overrides, Path(folder) / f"{scene}.fmu")
        names = [*pose, *times]
        reference = exchange.simulate(fmu, "CoSimulation", names, stop, 0.01)
        for tolerance in TOLERANCES:
            run = exchange.simulate(fmu, "ModelExchange", names, stop, 0.005, tolerance=tolerance)
            late = f"{exchange.worst(run, reference, times):.1e} s" if times else "-"
            away = exchange.worst(run, reference, pose)
            table.add(scene, f"{tolerance:.0e}", f"{away:.1e} m", late)
    return table


def list_derivatives(folder):
    """One row per instant of the default docking."""
    table = Table("instant", "pairs declared, of", "largest error of a row", "group")
    for instant, (overrides, time, size, _) in derivatives.INSTANTS.items():
        path = Path(folder) / f"{instant}.fmu"
        fmu = build_fmu(derivatives.DEFAULT, (derivatives.NEAR, *overrides), path)
        with derivatives.bring_to(fmu, time, size) as host:
            bristles = [n for n in host.variables if "ode.bristle" in n]
            some = [name for i, name in enumerate(bristles) if i % 40]
            jacobian = derivatives.Jacobian(host, leave_out=some)
            by_group, _ = jacobian.errors(jacobian.reported())
            worst = max(by_group, key=by_group.get)
            pairs = f"{np.count_nonzero(jacobian.declared)}, {jacobian.declared.size}"
            table.add(instant, pairs, f"{by_group[worst]:.1e}", worst)
    return table


with tempfile.TemporaryDirectory() as temporary:
    write_page(
        ROOT / "tests" / "validation" / "fmi.md",
        "Interfaces and derivatives of the FMU",
        "tests/studies/fmi.py",
        "The host integrates (CVODE of FMPy), against co-simulation at tight tolerance; largest"
        " difference at the end:",
        list_exchange(temporary),
        "Directional derivatives against central differences of sixth order, all declared pairs in"
        " the default docking, relative to the largest entry of a row (the differences limit it):",
        list_derivatives(temporary),
    )
