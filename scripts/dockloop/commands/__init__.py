"""The commands of ``dockloop``: one module each, which has the name of its command.

A module offers ``EXAMPLE``, ``add_options(command)`` and ``run(options)``. It loads quickly, since
``run`` imports what it needs. The command line loads only the module that is asked for. Next to
them are `arguments`, the parser with the options that several commands share, and `console`, what
a command prints.
"""

from importlib import import_module
from types import ModuleType

COMMANDS = {  # what each does, in the order of `dockloop --help`
    "new": "copy a scene and its mechanism, to be edited",
    "import": "make a mechanism of MJCF, URDF or SDF, and say what was mapped, guessed, left out",
    "export": "write a mechanism as MJCF, so that MuJoCo runs the same",
    "build": "build the FMU of a scene",
    "ssp": "build an SSP package: the docking FMU connected to one FMU per vehicle",
    "run": "run one docking through its FMU",
    "review": "write a report of one docking for a review board, as a page and as a PDF",
    "view": "write a page that shows a docking in three dimensions; it opens offline",
    "live": "open a page with sliders that computes the docking anew while one moves",
    "compare": "lay measured time histories over a run: time shift, peaks, energies, differences",
    "fit": "find parameters from measurements, with their uncertainty; plan which test to measure",
    "host-check": "judge a host that integrates a vehicle: a log of its reports, or a vehicle FMU",
    "linearise": "write the linear model at one instant: matrices, poles, Bode diagram",
    "sweep": "run many dockings: how many capture, and under which loads",
    "envelope": "find where dockings meet a criterion: its boundary in two or three quantities",
    "map": "map where a scene is right, refused or wrong over two quantities, and what that costs",
    "trade": "measure what accuracy costs: settings against the reference solution, and what pays",
    "check": "say whether a mechanism is sound",
    "extremes": "judge whole scenes drawn at random over many decades",
    "variables": "list what can be set and read: name, default, unit, limits, meaning",
    "truth": "integrate a scene with 32 digits, to measure errors against",
}


def load_command(name: str) -> ModuleType:
    """Load the module of a command; its name has no hyphens."""
    return import_module(f"{__name__}.{name.replace('-', '_')}")
