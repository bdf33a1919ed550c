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
    found = dl.fit("absorber_1d", "rig.csv",     # parameters from measurements
                   {"mechanism.set.contact.damping": (2e3, 4e4)})
    report = dl.check("idss_hexapod")            # is a mechanism sound?
    made = dl.import_mechanism("cad.sdf", "mine.json")  # from MJCF, URDF or SDF

Rooms by floor. A room imports from lower floors; on one floor, imports go one way::

    11  cli       the program: arguments in, text and exit status out
    11  commands  what the command line offers: parser, console, one module a command
    10  live      the page of a view with sliders, from a server on this machine
    10  review    the report of one docking for a review board
     9  api       what the function `sweep` does
     9  studies   questions over many runs: envelopes, maps, trades, random extremes, measurements
     9  view      a docking in three dimensions
     8  report    pages and figures of runs and sweeps
     7  sweeps    many dockings: samples, plan, campaign, executors, journal, table, rare events
     6  runs      one docking in this process, its linear model, whether it is right
     5  fmu       an FMU: made, described, driven by a host; SSP
     4  exchange  mechanisms of other tools: MJCF, URDF, SDF
     4  result    what a run left behind: recording, summary, criteria, errors, limits, files
     3  scene     scene file + mechanism file + overrides -> one document; places, shapes, names
     2  native    the compiled core: checks, placement, dockings, variables
     1  base      paths, files, errors, numbers, words, colours, reports, JSON Schemas

Nothing here computes dynamics; that is the C++ core.
"""

from typing import TYPE_CHECKING, Any

from dockloop.base import paths
from dockloop.base.version import __version__ as __version__

if TYPE_CHECKING:
    from dockloop.api import sweep
    from dockloop.base.errors import DockloopError, UsageError
    from dockloop.exchange.importing import import_mechanism
    from dockloop.result.recording import Result
    from dockloop.runs.docking import Docking, Scene, run
    from dockloop.runs.host_judging import HostCheck, host_check
    from dockloop.runs.linear import LinearModel, linearise
    from dockloop.scene.mechanism import check_mechanism as check
    from dockloop.studies.envelopes.command import Envelope, envelope
    from dockloop.studies.fits.command import Fit, fit, plan_fit
    from dockloop.studies.trades.command import trade
    from dockloop.sweeps.histories import read_histories
    from dockloop.sweeps.table import read_parts

__all__ = [
    "Docking",
    "DockloopError",
    "Envelope",
    "Fit",
    "HostCheck",
    "LinearModel",
    "Result",
    "Scene",
    "UsageError",
    "check",
    "envelope",
    "fit",
    "host_check",
    "import_mechanism",
    "linearise",
    "plan_fit",
    "read_histories",
    "read_parts",
    "run",
    "sweep",
    "trade",
]

if not paths.IS_INSTALLED:  # in a clone the compiled module is where the C++ build puts it
    __path__.append(str(paths.COMPILED))

_WHERE = {  # imported when they are used, so that a command starts quickly
    "Docking": "runs.docking",
    "DockloopError": "base.errors",
    "Envelope": "studies.envelopes.command",
    "Fit": "studies.fits.command",
    "HostCheck": "runs.host_judging",
    "LinearModel": "runs.linear",
    "Result": "result.recording",
    "Scene": "runs.docking",
    "UsageError": "base.errors",
    "check": "scene.mechanism",
    "envelope": "studies.envelopes.command",
    "fit": "studies.fits.command",
    "host_check": "runs.host_judging",
    "import_mechanism": "exchange.importing",
    "linearise": "runs.linear",
    "plan_fit": "studies.fits.command",
    "read_histories": "sweeps.histories",
    "read_parts": "sweeps.table",
    "run": "runs.docking",
    "sweep": "api",
    "trade": "studies.trades.command",
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
