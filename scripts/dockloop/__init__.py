"""dockloop: dynamics of docking mechanisms. The Python side of the C++ core.

From a notebook or a script::

    import dockloop as dl

    result = dl.run("idss_25t_350t", overrides={"initial.closing_speed": 0.05})
    result.summary["peak_loads"]

    docking = dl.Docking("idss_25t_350t")       # step it yourself
    table = dl.sweep("idss_initial_conditions")  # many of them: a pandas.DataFrame
    found = dl.envelope("idss_25t_350t", criteria="captured within 5 s",
                        x=("initial.lateral_offset", 0.0, 0.2),
                        y=("initial.closing_speed", 0.01, 0.15))
    table = dl.trade("idss_25t_350t", quick=True)  # speed against accuracy
    report = dl.check("idss_hexapod")            # is a mechanism sound?

Modules, in the order in which a docking passes through them::

    cli        the command line; arguments in, text and exit status out
    commands   one module a command: its options, and the calls that do its work
    arguments  the parser of a command, with options that several commands share
    console    what a command prints
    scene      scene file + mechanism file + overrides -> one resolved document
    schema     both files against their JSON Schemas, errors as one sentence
    core       the compiled module: checks, placement, model description, dockings
    docking    Scene, Docking and run: a docking in this process, without an FMU
    results    what a run left behind
    fmu        resolved document + compiled library -> NAME.fmu
    simulate   drives an FMU with FMPy and records its outputs
    summary    a recorded docking in words and numbers
    plots      the same as figures
    figures    how figures are written, and that they may be missing
    html_report  one page about a run, a sweep or an envelope
    outputs    which files a command may replace, and how all files are written

and many of them::

    sampling      sweep file -> the values of every case
    planning      the values of a case -> scene, start values, FMU
    executors     where cases run: threads of the core, or FMUs in Dask workers
    sweeps        runs all cases of a sweep that are not in its journal
    journal       results as they arrive, to go on with after an interruption
    cases         one case of a loaded FMU, as a Dask worker runs it
    sweep_report  the table, its summary in words and numbers, figures
    influence     which input decides an outcome, and from which value on
    criteria      "captured within 5 s and load_ratio < 1"
    rare          the part of dockings that fail when few do
    envelopes     the boundary of a criterion, with few dockings
    maps          where a scene is right, refused or wrong, over two quantities
    extremes      whole scenes drawn at random, each with a verdict
    trades        speed against accuracy of many settings
    run_errors    the error of a run against a reference result, for all commands
    accuracy      the error of a run, estimated by a second run
    judging       is a run right? for maps and random extremes
    crew          processes for that, which may be killed

and next to them::

    mechanism  is a mechanism sound?
    view       a docking in three dimensions
    measured   measured time histories over a run

and what has names: `variables` of a docking, and the `catalogue` of all that can be set and read.

Nothing here computes dynamics; that is the C++ core.
"""

from typing import TYPE_CHECKING, Any

from dockloop import paths

if TYPE_CHECKING:
    from dockloop.docking import Docking, Scene, run
    from dockloop.envelopes.command import Envelope, envelope
    from dockloop.errors import DockloopError, UsageError
    from dockloop.histories import read_histories
    from dockloop.linear import LinearModel, linearise
    from dockloop.mechanism import check_mechanism as check
    from dockloop.results import Result
    from dockloop.sweep_report import read_parts
    from dockloop.sweeps import sweep
    from dockloop.trades.command import trade

__version__ = "0.1.0"
__all__ = [
    "Docking",
    "DockloopError",
    "Envelope",
    "LinearModel",
    "Result",
    "Scene",
    "UsageError",
    "check",
    "envelope",
    "linearise",
    "read_histories",
    "read_parts",
    "run",
    "sweep",
    "trade",
]

if not paths.IS_INSTALLED:  # in a clone the compiled module is where the C++ build puts it
    __path__.append(str(paths.COMPILED))

_WHERE = {  # imported when they are used, so that a command starts quickly
    "Docking": "docking",
    "DockloopError": "errors",
    "Envelope": "envelopes.command",
    "LinearModel": "linear",
    "Result": "results",
    "Scene": "docking",
    "UsageError": "errors",
    "check": "mechanism",
    "envelope": "envelopes.command",
    "linearise": "linear",
    "read_histories": "histories",
    "read_parts": "sweep_report",
    "run": "docking",
    "sweep": "sweeps",
    "trade": "trades.command",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _WHERE:
        raise AttributeError(f"module 'dockloop' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(f"dockloop.{_WHERE[name]}")
    return getattr(module, {"check": "check_mechanism"}.get(name, name))


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
