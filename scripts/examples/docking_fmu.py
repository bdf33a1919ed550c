"""The FMU of the default docking in the hands of FMPy: what the examples next to it share.

`Docking` is what to copy: an FMU whose variables have names. The rest serves the examples: options,
and a table of how far two runs are apart.
"""

import argparse
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from dockloop.fmu.build import build_fmu
from dockloop.native.core import list_choices, list_loads, name_choice

SCENE = "idss_25t_350t"
MODES = {mode.name: mode.number for mode in list_choices("coupling.mode")}
ACCURATE = {"solver.rtol": 1e-9, "solver.atol_position": 1e-11, "solver.atol_velocity": 1e-11}
PEAKS = [f"capture.peak.{load}" for load in list_loads()]
RESULTS = ("time_of_contact", "time_of_capture", *PEAKS)


class Docking:
    """One docking. Names are without index: `chaser.position` is an array, `phase` a number."""

    def __init__(self, motion: str, step: float, settings: dict, keys: Sequence = ()) -> None:
        """Build and start it.

        Args:
            motion: of the chaser: `free` (integrated inside) or `driven` (by the host).
            step: between communication points, s.
            settings: parameters and start values by name.
            keys: of the scene, `KEY=VALUE`.
        """
        self.step, self.count = step, 0
        with tempfile.TemporaryDirectory() as folder:  # once it is loaded, it reads no file
            file = Path(folder) / "docking.fmu"
            fmu = str(build_fmu(SCENE, [f"chaser.motion={motion}", *keys], file, bare=True))
            description = read_model_description(fmu)
            self.slave = FMU2Slave(
                guid=description.guid,
                unzipDirectory=extract(fmu, folder),
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
            self.slave.instantiate()
        self.references, self.types, self.units = {}, {}, {}
        for variable in description.modelVariables:
            name = re.sub(r"\[\d+\]$", "", variable.name)
            self.references.setdefault(name, []).append(variable.valueReference)
            self.types[name], self.units[name] = variable.type, variable.unit
        self.slave.setupExperiment(startTime=0.0)
        for name, value in settings.items():
            self.put(name, value)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def get(self, name: str) -> np.ndarray | float:
        """Read a variable."""
        values = getattr(self.slave, f"get{self.types[name]}")(self.references[name])
        return np.array(values) if len(values) > 1 else values[0]

    def put(self, name: str, value: np.ndarray | float) -> None:
        """Set a parameter, a start value or an input."""
        put = getattr(self.slave, f"set{self.types[name]}")
        put(self.references[name], np.atleast_1d(value).tolist())

    def advance(self) -> None:
        """Make one communication step."""
        self.slave.doStep(self.count * self.step, self.step)
        self.count += 1


def make_parser(description: str, example: str, modes=MODES) -> argparse.ArgumentParser:
    """Return a parser of the options of all examples; `modes` are the orders that one can make."""
    parser = argparse.ArgumentParser(description=description, epilog=f"example: {example}")
    parser.add_argument(
        "--mode",
        choices=modes,
        default="parallel",
        help="coupling.mode, and the order of exchange that belongs to it (default: %(default)s)",
    )
    for name, default, text in (("step", 0.01, "communication step"), ("stop", 10.0, "end")):
        help_text = f"{text}, s (default: {default})"
        parser.add_argument(f"--{name}", type=time, default=default, metavar="T", help=help_text)
    return parser


def time(text: str) -> float:
    """Read a time, s."""
    if not 0.0 < (value := float(text)) < 1e6:
        raise argparse.ArgumentTypeError(f"{text} s is not between 0 and 1e6 s")
    return value


def symmetric(components: np.ndarray) -> np.ndarray:
    """Return an inertia matrix from its components xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = components
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def print_comparison(coupled: Docking, alone: Docking) -> None:
    """Print the results of a docking with a host, and of one that integrates both vehicles."""
    print(f"{'':29} {'with host':>15} {'one FMU':>15} {'difference':>11}")
    outcomes = [name_choice("outcome", docking.get("outcome")) for docking in (coupled, alone)]
    print(f"{'outcome':29} {outcomes[0]:>15} {outcomes[1]:>15}")
    for name in RESULTS:
        a, b = coupled.get(name), alone.get(name)
        print(f"{name:25} {coupled.units[name]:3} {a:15.6f} {b:15.6f} {a - b:11.1e}")
    apart = [d.get("chaser.position") - d.get("target.position") for d in (coupled, alone)]
    distance = np.linalg.norm(apart[0] - apart[1])
    print(f"chaser seen from the target, at the end: {distance:.3e} m from where it is in one FMU")
