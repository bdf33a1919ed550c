"""The command ``dockloop linearise``: runs to the instant, writes matrices and Bode diagram."""

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from dockloop.base import paths
from dockloop.base.figures import can_draw, save_figure
from dockloop.base.files import MADE_BY, check_suffix, claim, figure_kind, json_kind
from dockloop.base.number import read_if_number, say_number
from dockloop.base.palette import style_line
from dockloop.base.sections import FACTS, Section, list_files
from dockloop.native.core import name_choice
from dockloop.result.summary import write_summary
from dockloop.runs.docking import Docking
from dockloop.runs.linear import LinearModel, check_pair, find_linear_model
from dockloop.scene.find import find_scene
from dockloop.sweeps.settings import parse_setting, parse_settings

COMMAND = "dockloop linearise"
_POINTS = 400  # frequencies of a Bode diagram, next to the natural ones
_BAND = (1e-3, 1e2)  # Hz, of a model without oscillations
_INPUTS, _OUTPUTS = ("chaser.force_ext[1]",), ("relative.axial", "ring.position[1]")


def run_command(options: argparse.Namespace) -> dict[str, Any]:
    """Linearise, write the files, and return the document.

    Raises:
        UsageError: an option is bad, or the docking does not come to the instant.
        DockloopError: a step failed, or a file cannot be written.
    """
    output, figure = _claim(options)
    overrides = parse_settings("--scene", options.overrides)
    for name in ("stop", "step"):
        if getattr(options, name) is not None:
            overrides[f"experiment.{name}"] = getattr(options, name)
    docking = Docking(options.scene, overrides)
    for text in options.set:
        docking.set(*parse_setting("--set", text))
    if options.bode:
        check_pair(docking, *options.bode)
    model = find_linear_model(docking, read_if_number(options.at))
    found = make_document(model, *(options.bode or choose_pair(model)))
    files = [output]
    if not options.no_plots and can_draw():
        save_figure(draw(found), figure, COMMAND)
        files.append(figure)
    write_summary(found, output, files)
    return found


def choose_pair(model: LinearModel) -> tuple[str, str]:
    """Return input and output of the Bode diagram unless the user names them: axial ones."""
    return (
        next(name for name in (*_INPUTS, *model.inputs) if name in model.inputs),
        next(name for name in (*_OUTPUTS, *model.outputs) if name in model.outputs),
    )


def make_document(model: LinearModel, input_: str, output: str) -> dict[str, Any]:
    """Return a linear model with poles and one frequency response, for JSON.

    Raises:
        UsageError: there is no such input or output.
    """
    docking, variables = model.docking, model.docking.variables

    def list_units(names: list[str]) -> list[dict[str, str]]:
        return [{"name": name, "unit": variables[name].unit} for name in names]

    moving = model.moving
    stack = ("mass", "com", "inertia") if "stack.mass" in variables else ()
    return {
        MADE_BY: COMMAND,
        "scene": docking.scene.name,
        "title": docking.scene.title,
        "time": model.time,
        "phase": name_choice("phase", docking.get("phase")) if "phase" in variables else None,
        "stack": {name: np.asarray(docking.get(f"stack.{name}")).tolist() for name in stack},
        "interface": None
        if model.stiffness is None or model.damping is None
        else {"stiffness": model.stiffness.tolist(), "damping": model.damping.tolist()},
        "poles": [_describe_pole(pole) for pole in moving],
        "slow_poles": len(model.states) - sum(2 if pole.imag else 1 for pole in moving),
        "turn_rate": model.turn_rate,
        "bode": _find_bode(model, input_, output),
        "states": list_units(model.states),
        "inputs": list_units(model.inputs),
        "outputs": list_units(model.outputs),
        **{name: getattr(model, name).tolist() for name in "ABCD"},
    }


def report_linear(found: dict[str, Any]) -> list[Section]:
    """Return the report of a linear model: the instant, the stack, poles, files."""
    sizes = ", ".join(f"{len(found[kind])} {kind}" for kind in ("states", "inputs", "outputs"))
    units = {"mass": "kg", "com": "m", "inertia": "kg m2"}
    bode = found["bode"]
    largest = int(np.argmax(bode["magnitude"]))
    facts = [
        ("time", f"{found['time']:.6g} s"),
        *([("phase", found["phase"])] if found["phase"] else []),
        ("model", sizes),
        *(
            (f"stack.{name}", f"{'  '.join(map(say_number, np.ravel(value)))} {units[name]}")
            for name, value in found["stack"].items()
        ),
        (
            "Bode",
            f"{bode['input']} to {bode['output']}: largest at {bode['frequency'][largest]:.4g} Hz,"
            f" {bode['magnitude'][largest]:.4g} {bode['unit']}",
        ),
        *list_files(found["files"]),
    ]
    poles: list[tuple[Any, ...]] = [
        ("pole [1/s]", "frequency [Hz]", "damping ratio", "time constant [s]")
    ]
    for pole in found["poles"]:
        imaginary = f" +-{pole['imaginary']:.4g}i" if pole["imaginary"] else ""
        numbers = (pole[name] for name in ("frequency", "damping_ratio", "time_constant"))
        poles.append((f"{pole['real']:.4g}{imaginary}", *numbers))
    text = (
        f"{found['slow_poles']} poles are zero, or slower than the vehicles turn"
        f" ({found['turn_rate']:.3g} rad/s)."
    )
    if any(pole["real"] > 0.0 for pole in found["poles"]):
        text += " A time constant below 0 is that of growth."
    return [
        Section(f"{found['scene']}: {found['title']}", table=[FACTS, *facts]),
        Section("Poles", text, poles),
        *([_report_interface(found["interface"])] if found["interface"] else []),
    ]


def _report_interface(interface: dict[str, list[list[float]]]) -> Section:
    """Return the diagonals of the matrices of the docking interface."""
    rows: list[tuple[Any, ...]] = [
        ("of P", "along x", "along y", "along z", "about x", "about y", "about z")
    ]
    units = {"stiffness": "N/m, N m/rad", "damping": "N s/m, N m s/rad"}
    for name, unit in units.items():
        rows.append((f"{name} [{unit}]", *(interface[name][i][i] for i in range(6))))
    return Section("Docking interface", "In axes of A, diagonals; the file has the matrices.", rows)


def draw(found: dict[str, Any]) -> Any:
    """Return the Bode diagram of a document: magnitude and phase over the frequency."""
    from matplotlib.figure import Figure

    bode = found["bode"]
    figure = Figure(figsize=(9, 6), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    magnitude = np.array(bode["magnitude"])
    top.plot(bode["frequency"], np.where(magnitude > 0.0, magnitude, np.nan), **style_line(0))
    bottom.plot(bode["frequency"], bode["phase"], **style_line(0))
    top.set_xscale("log")
    if magnitude.any():
        top.set_yscale("log")
    top.set_ylabel(f"magnitude [{bode['unit']}]")
    bottom.set_ylabel("phase [deg]")
    bottom.set_xlabel("frequency [Hz]")
    for axis in (top, bottom):
        axis.grid(alpha=0.3)
    top.set_title(
        f"{found['title']}, {found['time']:.4g} s: {bode['input']} to {bode['output']}",
        fontsize="medium",
    )
    return figure


def _claim(options: argparse.Namespace) -> tuple[Path, Path]:
    """Return the files to write, after making sure that they can be written."""
    name = find_scene(options.scene).stem
    output = options.output or paths.RESULTS / "results" / name / f"{name}_linear.json"
    check_suffix(output, ".json")
    figure = output.with_suffix(".png")
    claim(output, json_kind("linear model", COMMAND))
    if not options.no_plots:
        claim(figure, figure_kind(COMMAND))
    return output, figure


def _describe_pole(pole: complex) -> dict[str, float | None]:
    """Return a pole [1/s]: frequency [Hz] and damping ratio of a pair, time constant [s]."""
    size = abs(pole)
    return {
        "real": pole.real,
        "imaginary": pole.imag,
        "frequency": size / (2.0 * math.pi) if pole.imag else None,
        "damping_ratio": -pole.real / size if pole.imag else None,
        "time_constant": -1.0 / pole.real if pole.real else None,
    }


def _find_bode(model: LinearModel, input_: str, output: str) -> dict[str, Any]:
    """Return a frequency response: frequencies [Hz], magnitudes, phases [deg]."""
    natural = [frequency for frequency, _ in model.oscillations]
    low, high = (0.1 * min(natural), 10.0 * max(natural)) if natural else _BAND
    frequency = np.unique([*np.geomspace(low, high, _POINTS), *natural])
    response = model.find_response(output, input_, frequency.tolist())
    units = [model.docking.variables[name].unit for name in (output, input_)]
    return {
        "input": input_,
        "output": output,
        "unit": "/".join(f"({unit})" if "/" in unit else unit for unit in units),
        "frequency": frequency.tolist(),
        "magnitude": np.abs(response).tolist(),
        "phase": np.degrees(np.unwrap(np.angle(response))).tolist(),
    }
