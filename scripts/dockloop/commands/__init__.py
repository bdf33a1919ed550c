"""The commands of ``dockloop``: one module each, which has the name of its command.

A module offers ``EXAMPLE``, ``add_options(command)`` and ``run(options)``. It loads quickly, since
``run`` imports what it needs. The command line loads only the module that is asked for.
"""

COMMANDS = {  # what each does, in the order of `dockloop --help`
    "new": "copy a scene and its mechanism, to be edited",
    "build": "build the FMU of a scene",
    "ssp": "build an SSP package: the docking FMU connected to one FMU per vehicle",
    "run": "run one docking through its FMU",
    "view": "write a page that shows a docking in three dimensions; it opens offline",
    "compare": "lay measured time histories over a run: time shift, peaks, energies, differences",
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
