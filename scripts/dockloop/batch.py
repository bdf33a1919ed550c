"""Runs the cases of a sweep in the compiled core, on threads of one process: no FMU, no Dask.

``dockloop-core batch`` steps the same simulation through the same communication points as a worker
steps the FMU, so results are the same to the last bit if both were made by one compiler, else to
rounding. Cases go to it as they are planned, one line
of JSON each; results come back in the order of the cases.
"""

import json
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TextIO

from dockloop.cases import Result
from dockloop.core import find_core
from dockloop.errors import DockloopError, UsageError
from dockloop.fmu import NEVER_TOUCH, to_json

if TYPE_CHECKING:
    from dockloop.sweep import Planner


def run_batch(
    planner: "Planner",
    cases: Iterable[tuple],
    threads: int,
    keep: Callable[[tuple, Result], None],
    report: Callable[[], None],
) -> None:
    """Run cases, keep each result as soon as it and all before it are there.

    Args:
        planner: plans them.
        cases: their values.
        threads: that run cases at a time.
        keep: is told values and result of a case.
        report: is called after every case.

    Raises:
        DockloopError: the core is missing or ended early.
    """
    with tempfile.TemporaryDirectory(prefix="dockloop-") as folder, ThreadPoolExecutor(1) as pool:
        model = Path(folder) / "model.json"
        model.write_text(to_json(planner.unplaced))
        with subprocess.Popen(
            [find_core(), "batch", model, *_list_options(planner, threads)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            start_new_session=True,  # a Ctrl-C is for this process, which ends the core
        ) as core:
            planned: SimpleQueue = SimpleQueue()
            feeding = pool.submit(_feed, planner, cases, core.stdin, planned)
            try:
                while (case := planned.get()) is not None:
                    values, refusal = case
                    keep(values, refusal or _read_result(core, model, planner))
                    report()
            except BaseException:
                core.kill()
                with suppress(OSError):  # what is still on its way to a core that has ended
                    core.stdin.close()
                raise
        feeding.result()  # raises what the planner did


def make_patch(old: dict, new: dict) -> dict:
    """Return the JSON merge patch (RFC 7386) that turns one document into another."""
    patch: dict[str, Any] = {name: None for name in old if name not in new}
    for name, value in new.items():
        if isinstance(value, dict) and isinstance(old.get(name), dict):
            if inner := make_patch(old[name], value):
                patch[name] = inner
        elif name not in old or repr(value) != repr(old[name]):  # 0.0 is not -0.0
            patch[name] = value
    return patch


def _list_options(planner: "Planner", threads: int) -> list[str]:
    """Return the order to the core as words of a command line."""
    words = ["--threads", str(threads)]
    for name, value in planner.experiment.items():
        words += [f"--{name.replace('_', '-')}", repr(float(value))]
    for name in planner.outcomes:
        words += ["--output", name]
    return words


def _feed(planner: "Planner", cases: Iterable[tuple], core: TextIO, planned: SimpleQueue) -> None:
    """Plan cases, write them to the core; `planned` gets values and refusal of each, then None."""
    try:
        with core:
            for values in cases:
                try:
                    line = json.dumps(planner.plan_batch(values))
                except UsageError as error:
                    planned.put((values, Result("refused", planner.without_folder(str(error)))))
                    continue
                planned.put((values, None))
                print(line, file=core, flush=True)
    finally:
        planned.put(None)


def _read_result(core: subprocess.Popen, model: Path, planner: "Planner") -> Result:
    """Read the next result, in the words that a worker with the FMU has for it."""
    line = core.stdout.readline()
    if not line.endswith("\n"):
        status, said = core.wait(), core.stderr.read().strip().replace(str(model), "the scene")
        raise DockloopError(
            f"dockloop-core batch ended with status {status} ({said or 'no message'});"
            " the same command with --resume goes on, with --engine fmu even past what ends it"
        )
    told = json.loads(line)
    status, reason, time = told["status"], told.get("reason"), told.get("end_time")
    if reason is not None:
        scene = f"{planner.base['name']}.toml"
        reason = reason.replace(str(model), scene) if str(model) in reason else f"the FMU: {reason}"
        reason = f"at {time:.9g} s: {reason}" if status == "failed" else reason
    warnings = [] if told.get("touches", True) else [NEVER_TOUCH]
    warnings += told["warnings"] if status == "done" else []
    return Result(status, reason, "; ".join(warnings) or None, time, tuple(told.get("outputs", ())))
