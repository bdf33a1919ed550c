"""Many dockings from Python: `sweep`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dockloop.base.errors import names_arguments
from dockloop.base.files import check_suffix, claim, scratch
from dockloop.base.number import to_plain
from dockloop.base.paths import as_path
from dockloop.base.progress import import_optional
from dockloop.runs.docking import Scene

if TYPE_CHECKING:
    import pandas as pd


@names_arguments
def sweep(
    reference: str | Path | dict,
    *,
    cases: "str | Path | pd.DataFrame | None" = None,
    fitted: str | Path | None = None,
    output: str | Path | None = None,
    engine: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    accuracy: float | str | None = None,
    refine: str | None = None,
    refine_accuracy: float | str | None = None,
    assured: bool = False,
) -> "pd.DataFrame":
    """Run many dockings and return what became of them.

    Args:
        reference: name of a shipped sweep, path of a ``.toml`` file, or the members of such a file;
            there the scene may be a `dockloop.Scene`, or the members of a scene file.
        cases: a table of cases, in place of the key ``cases``: a path (CSV, Excel, Parquet) or a
            ``pandas.DataFrame``. A row is a case, a column a key of the scene or a start value;
            the column ``name`` names the cases. ``reference`` may then be ``{"scene": NAME}``.
        fitted: the result of ``dockloop fit`` (``fit.json``): its parameters vary, too, with their
            covariance and within their ranges; those that are not identified are uniform there.
        output: a ``.parquet`` file for the table; journal and histories are next to it. Default:
            no files.
        engine: ``core`` (threads), ``fmu`` (Dask workers) or ``auto``: threads without scheduler.
        workers: local threads or processes; default: one per processor.
        scheduler: address of a Dask scheduler to use instead.
        resume: go on with the journal of `output`.
        accuracy: wanted relative error of all cases, or ``"real-time"``.
        refine: criterion of cases that run again, such as ``"load_ratio > 0.8 or not captured"``.
        refine_accuracy: wanted relative error of these.
        assured: run each case again with tighter settings until two runs agree within the
            accuracy; the columns ``assured``, ``settings`` and ``price`` say what was found.

    Returns:
        One row per case: ``case``, the quantities, ``status``, ``reason``, ``warning``,
        ``end_time`` [s], the outcomes at the end; with `refine` also those of the first pass,
        ``first.NAME``. Units are in ``table.attrs["units"]``, the summary of ``dockloop sweep
        --json`` is in ``table.attrs["summary"]``. With the key ``histories`` in the sweep,
        ``table.attrs["histories"]`` has a `Result` by the number of each case that was done.

    Raises:
        UsageError: the sweep, a name in it or the journal is bad.
        DockloopError: a package is missing, or the executor cannot be used.
    """
    import_optional("pandas")
    import_optional("pyarrow")
    from dockloop.report.sweep import summarise_sweep
    from dockloop.sweeps.histories import HISTORIES, Histories, find_histories, write_histories
    from dockloop.sweeps.run import run_sweep
    from dockloop.sweeps.sampling import make_sweep, read_passes, read_sweep
    from dockloop.sweeps.table import TableFile, write_table

    passes = read_passes(accuracy, refine, refine_accuracy)
    fit = None if fitted is None else str(as_path("fitted", fitted))
    if isinstance(reference, dict):
        members = reference if cases is None else {**reference, "cases": cases}
        drawn = make_sweep(to_plain(_name_scene(members)), Path("sweep"), passes=passes, fitted=fit)
    else:
        drawn = read_sweep(str(reference), passes, cases, fit)
    with scratch() as folder:
        place = as_path("-o", output) if output else folder / "sweep.parquet"
        check_suffix(place, ".parquet")
        if "histories" in drawn.document:
            claim(find_histories(place), HISTORIES)
        ran = run_sweep(
            replace(drawn, assured=bool(assured)),
            place,
            engine=engine,
            workers=workers,
            scheduler=scheduler,
            resume=resume,
        )
        drawn = ran["sweep"]
        write_table(drawn, ran["planner"], ran["results"], ran["first"], place)
        table = TableFile(place)
        frame = table.to_pandas()
        frame.attrs["summary"] = summarise_sweep(drawn, ran["planner"], table, ran)
        if ran["planner"].histories:
            file = find_histories(place)
            write_histories(ran["planner"], ran["results"], file)
            frame.attrs["histories"] = Histories(file.read_bytes())
    return frame


def _name_scene(members: dict) -> dict:
    """Return the members of a sweep file, where a scene has a name; its overrides are set."""
    scene = members.get("scene")
    if not isinstance(scene, Scene):
        return members
    return {**members, "scene": scene.reference, "set": scene.overrides | members.get("set", {})}
