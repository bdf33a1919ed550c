"""The reference solution that every run is compared with, from the best source.

`dockloop-compare truth`, where it can be compiled: the same model in extended precision. Otherwise,
and for a quick trade, the FMU itself, by its explicit method at the tightest tolerance; a second
run at ten times the tolerance says how far that may be off. Where both are there, a peak is that of
the one that states the smaller error: the long steps of a high order know the motion best, but
short ones the peaks.
The result is a file in ``build/truth``, named by a key of all that decides it, so that it is found
once::

    {"source": ..., "time": [...], "values": {NAME: [...]}, "error": {NAME: ...},
     "tolerance": ..., "digits": ..., "evaluations": ...}
"""

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dockloop.base import paths
from dockloop.base.errors import DockloopError, UsageError, find_reason
from dockloop.base.files import MADE_BY, claim, json_kind, write_text
from dockloop.base.paths import shown
from dockloop.native.compiled import find_compiled
from dockloop.native.core import FULL, ask_program, number_choice
from dockloop.result.criteria import PEAK
from dockloop.result.recording import Result
from dockloop.studies.trades.bench import Bench

_RTOL = 1e-13
_FILE = json_kind("truth", "dockloop trade")
_CORE_TOLERANCE = 1e-16  # far below what any setting reaches; less only takes longer


@dataclass
class Solution:
    """What should have come out.

    Attributes:
        recording: the outputs at every point of time.
        doubt: the same, off by the errors that are stated.
        source: where it is from.
        key: of all that decides it.
        facts: tolerance, digits and evaluations.
    """

    recording: Result
    doubt: Result
    source: str
    key: str
    facts: dict


def find_solution(
    bench: Bench,
    stop: float,
    step: float,
    names: list[str],
    say: Callable[[str], None] = lambda _: None,
    *,
    quick: bool = False,
) -> Solution:
    """Return the reference solution of a scene, from its file or found anew.

    Args:
        bench: the FMU of the scene.
        stop: end [s].
        step: between two points of time [s].
        names: outputs.
        say: called when it must be found anew.
        quick: of the FMU itself, in a fiftieth of the time.
    """
    program = None if quick else _find_program()
    decides = [bench.fmu_digest, stop, step, names, _RTOL]
    if program:
        decides += [hashlib.sha256(program.read_bytes()).hexdigest(), _CORE_TOLERANCE]
    key = hashlib.sha256(json.dumps(decides).encode()).hexdigest()[:16]
    file = paths.RESULTS / "truth" / f"{bench.scene['name']}_{key}.json"
    if os.path.lexists(file):
        try:
            return _read(json.loads(file.read_text(encoding="utf-8")), names, bench, key)
        except OSError as error:
            raise UsageError(f"{shown(file)}: cannot be read ({find_reason(error)})") from None
        except (ValueError, KeyError, TypeError, AttributeError):
            raise UsageError(
                f"{shown(file)}: is no reference solution that can be read: delete it"
            ) from None
    claim(file, _FILE)
    say("finding the reference solution")
    document = (_ask_core if program else _ask_fmu)(bench, stop, step, names)
    write_text(file, _FILE, json.dumps({MADE_BY: _FILE.command, **document}))
    return _read(document, names, bench, key)


def _read(document: dict, names: list[str], bench: Bench, key: str) -> Solution:
    columns = [document["time"], *(document["values"][name] for name in names)]
    values = np.array(columns, dtype=float).T
    units = ["s", *(bench.variables[name].unit or "" for name in names)]
    recording = Result(bench.scene, ["time", *names], units, values)
    errors = np.array([0.0, *(document["error"][name] for name in names)])
    doubt = replace(recording, values=values + errors)
    facts = {name: document[name] for name in ("tolerance", "digits", "evaluations")}
    return Solution(recording, doubt, document["source"], key, facts)


def _find_program() -> Path | None:
    """Return the program that knows the reference solution; None where it cannot be compiled."""
    try:
        return find_compiled(paths.COMPARE)[0]
    except DockloopError:
        return None


def _level(bench: Bench) -> dict[str, int]:
    """Return the start value that chooses the whole mechanism, if the FMU has levels."""
    name = "model.level"
    return {} if bench.start(name) is None else {name: number_choice(name, FULL)}


def _ask_core(bench: Bench, stop: float, step: float, names: list[str]) -> dict:
    options = ["--stop", repr(stop), "--step", repr(step)]
    options += ["--tolerance", repr(_CORE_TOLERANCE), "--check"]
    options += [word for name in names for word in ("--output", name)]
    options += [word for name, n in _level(bench).items() for word in ("--set", f"{name}={n}")]
    of_fmu = _ask_fmu(bench, stop, step, names)
    try:
        reported = ask_program(paths.COMPARE, "truth", bench.model, *options)
    except DockloopError as error:
        reason = str(error).replace(f"{shown(bench.model)}: ", "")
        return {**of_fmu, "source": f"{of_fmu['source']} (dockloop truth: {reason})"}
    document = {
        "source": "dockloop truth",
        "time": reported["time"],
        "values": reported["output"],
        "error": reported["check"]["difference"],
        "tolerance": reported["tolerance"],
        "digits": reported["digits"],
        "evaluations": reported["work"]["evaluations"],
    }
    peaks = [name for name in names if name.startswith(PEAK)]
    worse = [name for name in peaks if document["error"][name] > of_fmu["error"][name]]
    for name in worse:
        for member in ("values", "error"):
            document[member][name] = of_fmu[member][name]
    if worse:
        document["source"] += f"; {', '.join(worse)}: {of_fmu['source']}"
    return document


def _ask_fmu(bench: Bench, stop: float, step: float, names: list[str]) -> dict:
    def run(rtol: float) -> Result:
        method = {"solver.method": number_choice("solver.method", "explicit")}
        starts = {**_level(bench), **method, **bench.tolerances(rtol)}
        return bench.run(starts, stop, step)

    best, check = run(_RTOL), run(10.0 * _RTOL)
    return {
        "source": f"the FMU itself, explicit at a relative tolerance of {_RTOL:g}, its error by a"
        " second run at ten times that",
        "time": best["time"].tolist(),
        "values": {name: best[name].tolist() for name in names},
        "error": {name: float(np.max(np.abs(best[name] - check[name]))) for name in names},
        "tolerance": _RTOL,
        "digits": 16,
        "evaluations": float(best["solver.rhs_evaluations"][-1]),
    }
