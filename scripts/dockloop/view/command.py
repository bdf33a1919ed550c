"""The command ``dockloop view``: page, stills or film of a result, or of cases of a sweep."""

import argparse
import json
import re
import shlex
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dockloop.errors import UsageError, did_you_mean
from dockloop.number import read_number
from dockloop.outputs import Kind, claim, scratch
from dockloop.paths import shown
from dockloop.results import Result
from dockloop.summary import RESULT
from dockloop.view.page import PAGE, find_events, write_page
from dockloop.view.pictures import FILM, STILL, write_film, write_stills
from dockloop.view.results import read_result, read_state

if TYPE_CHECKING:
    from dockloop.sweep_report import TableFile

_SIZE = re.compile(r"(\d{2,5})x(\d{2,5})")
_MOST_CASES = 20


def view(options: argparse.Namespace) -> str:
    """Write what was asked for.

    Returns:
        What was written, for people.

    Raises:
        UsageError: a file or an option is bad.
        DockloopError: it cannot be written or drawn.
    """
    source = Path(options.result)
    suffix = ".png" if options.still else ".mp4" if options.film else ".html"
    if options.still and options.film:
        raise UsageError("--still and --film: give one of them")
    _check_belonging(options)
    output = options.output or _name(source, suffix)
    if output.suffix != suffix:
        what = {".png": "stills", ".mp4": "a film", ".html": "a page"}[suffix]
        hint = "" if suffix != ".html" else "; pictures: --still or --film"
        raise UsageError(f"-o {output}: must end in {suffix} for {what}{hint}")
    meshes = _parse_meshes(options.meshes)
    if source.suffix == ".parquet" and not _is_run(source):
        if options.model:
            raise UsageError("--model: the table of a sweep holds its model")
        return _view_sweep(source, output, options, meshes)
    if options.cases or options.not_captured is not None:
        raise UsageError(f"--case, --not-captured: {shown(source)} is no table of a sweep")
    if (source.suffix == ".fmu") != bool(options.state):
        raise UsageError(f"{shown(source)}: an FMU and a --state go together, one needs the other")
    if options.state and (options.film or options.model):
        raise UsageError("--film, --model: a saved state is one moment of its own FMU")
    for file, kind in _list_files(output, options):
        claim(file, kind)
    state = options.state
    run = read_state(source, state) if state else read_result(source, options.model)
    return _write(run, output, options, meshes, None)


def _check_belonging(options: argparse.Namespace) -> None:
    """Refuse an option of stills or films where there are none."""
    for names, is_on, remedy in (
        (("from", "to", "speed"), options.film, "a film: add --film"),
        (("camera", "size"), options.film or options.still, "pictures: add --still or --film"),
    ):
        for name in names:
            value = getattr(options, {"from": "begin", "to": "end"}.get(name, name))
            if value is not None and not is_on:
                raise UsageError(f"--{name} {value}: belongs to {remedy}")


def _is_run(source: Path) -> bool:
    """Return whether a table is that of one run, not of a sweep."""
    try:
        return RESULT.is_own(source)
    except Exception:  # noqa: BLE001  what cannot be read is refused later, with its reason
        return False


def _write(
    run: Result,
    output: Path,
    options: argparse.Namespace,
    meshes: dict[str, Path],
    command: str | None,
) -> str:
    """Write page, stills or film of one recording; returns what was written."""
    if not (options.still or options.film):
        return describe_page(output, write_page(run, output, command=command, meshes=meshes))
    camera = options.camera or "oblique"
    found = _SIZE.fullmatch(options.size or "1280x800")
    if not found:
        raise UsageError(f"--size {options.size}: must be WIDTHxHEIGHT, for example 1280x800")
    width, height = int(found[1]), int(found[2])
    with scratch() as folder:
        page = folder / "page.html"
        write_page(run, page, command=command, meshes=meshes)
        if options.still:
            files = [file for file, _ in _list_files(output, options)]
            moments = _parse_moments(options.still, run)
            shots = dict(zip(files, moments, strict=True))
            write_stills(page, shots, camera, (width, height))
            return "\n".join(shown(file) for file in files)
        times = run["time"]
        begin = float(times[0] if options.begin is None else options.begin)
        end = float(times[-1] if options.end is None else options.end)
        if not times[0] <= begin < end <= times[-1]:
            raise UsageError(
                f"--from {begin:g} --to {end:g}: must lie in order between {times[0]:g} and"
                f" {times[-1]:g} s, where the result begins and ends"
            )
        speed = 1.0 if options.speed is None else options.speed
        if speed <= 0.0:
            raise UsageError(f"--speed {speed}: must be above 0")
        count = write_film(
            page,
            output,
            (begin, end),
            speed=speed,
            camera=camera,
            size=(width, height),
        )
    return f"{shown(output)} ({count} pictures, {output.stat().st_size / 1e6:.1f} MB)"


def describe_page(path: Path, written: dict) -> str:
    """Say what a page is."""
    text = f"{shown(path)} ({written['bytes'] / 1e6:.1f} MB, {written['samples']} samples"
    if written["every"] > 1.0:
        text += f", one of {written['every']:.1f}"
    return f"{text}): open it in a browser"


def _view_sweep(
    table: Path, output: Path, options: argparse.Namespace, meshes: dict[str, Path]
) -> str:
    """Run cases of a sweep again and write one page for each."""
    from dockloop.sweep_report import open_table
    from dockloop.sweeps import read_table_metadata

    rows, metadata = open_table(table), read_table_metadata(table)
    try:
        cases = _choose_cases(table, rows, metadata, options)
    except (OSError, ValueError) as error:
        raise UsageError(f"{shown(table)}: cannot be read ({error})") from None
    outputs = {case: output.with_stem(f"{output.stem}_case{case}") for case in cases}
    if options.output and len(cases) == 1:
        outputs = {cases[0]: output}
    for file in outputs.values():
        for part, kind in _list_files(file, options):
            claim(part, kind)
    lines = []
    for case, file in outputs.items():
        with scratch() as folder:
            words = find_command(table, metadata, case, folder)
            run = run_again(words, f"case {case} of {shown(table)}")
        words[2] = tomllib.loads(metadata["dockloop.sweep"])["scene"]
        lines.append(_write(run, file, options, meshes, shlex.join(words)))
    return "\n".join(lines)


def run_again(words: list[str], label: str) -> Result:
    """Return what a case of a sweep records.

    Args:
        words: of its command (`Planner.make_command`).
        label: what errors call it.
    """
    from dockloop.fmu import build_fmu
    from dockloop.simulate import run_fmu

    overrides, settings = _list_values(words, "--scene"), _list_values(words, "--set")
    stop, step = (float(_list_values(words, name)[0]) for name in ("--stop", "--step"))
    with scratch() as folder:
        fmu = build_fmu(words[2], overrides, folder / f"{Path(words[2]).stem}.fmu", bare=True)
        return run_fmu(fmu, settings, stop, step, label=label)


def _choose_cases(
    table: Path, rows: "TableFile", metadata: dict[str, str], options: argparse.Namespace
) -> list[int]:
    """Return the numbers of the cases to show, from 1; columns are read one by one."""
    count = options.not_captured
    if options.cases and count is not None:
        raise UsageError("--case and --not-captured: give one of them")
    for case in options.cases:
        if not 1 <= case <= len(rows):
            raise UsageError(f"--case {case}: {shown(table)} has the cases 1 to {len(rows)}")
        row = rows.read_row(case - 1, ["status", "reason"])
        if row["status"] != "done":
            raise UsageError(f"--case {case}: was not done in {shown(table)} ({row['reason']})")
    if options.cases:
        return list(dict.fromkeys(options.cases))
    if count is not None and not 1 <= count <= _MOST_CASES:
        raise UsageError(f"--not-captured {count}: must be 1 to {_MOST_CASES}")
    worst = tomllib.loads(metadata["dockloop.sweep"]).get("worst", "capture.peak.load_ratio")
    return _find_cases(table, rows, worst if count is None else "outcome", count)


def _find_cases(table: Path, rows: "TableFile", by: str, count: int | None) -> list[int]:
    """Return the case with the largest value of a column, or so many that were not captured."""
    from dockloop.sweep_report import count_texts, has_captured, is_text, list_worst, read_numbers

    done = count_texts(rows["status"]).get("done", 0)
    if not done:
        raise UsageError(f"{shown(table)}: no case was done, so there is none to show")
    found: list[int] = []
    if by in rows.column_names and count is not None:
        found = np.flatnonzero(has_captured(rows) == 0.0)[:count].tolist()
        if not found:
            raise UsageError(f"{shown(table)}: all {done} cases were captured")
    elif by in rows.column_names and not is_text(rows, by):
        found = list_worst(read_numbers(rows, by), 1)
    if not found:
        raise UsageError(f"{shown(table)}: '{by}' is no column of it, so name a --case")
    return [row + 1 for row in found]


def find_command(table: Path, metadata: dict[str, str], case: int, folder: Path) -> list[str]:
    """Return the words of the command that runs a case by itself.

    The sweep, a scene of the user and its mechanisms are written as they were when the table was
    made.
    """
    from dockloop.sampling import Passes, read_sweep
    from dockloop.sweep_report import open_table
    from dockloop.sweeps import DIGEST, Planner

    text, named = metadata["dockloop.sweep"], tomllib.loads(metadata["dockloop.sweep"])["scene"]
    file = folder / "sweep.toml"
    file.write_text(text, encoding="utf-8")
    if named.endswith(".toml"):
        scene = folder / named
        if not scene.resolve().is_relative_to(folder.resolve()):
            scene = folder / Path(named).name
            file.write_text(text.replace(named, scene.name), encoding="utf-8")
        scene.parent.mkdir(parents=True, exist_ok=True)
        scene.write_text(metadata["dockloop.scene"], encoding="utf-8")
        for name, content in json.loads(metadata.get("dockloop.mechanisms", "{}")).items():
            mechanism = scene.parent / f"{name}.json"
            if mechanism.resolve().is_relative_to(folder.resolve()):
                mechanism.parent.mkdir(parents=True, exist_ok=True)
                mechanism.write_text(content, encoding="utf-8")
    passes = json.loads(metadata.get("dockloop.passes", "null"))
    sweep = read_sweep(str(file), passes and Passes(**passes))
    try:
        planner = Planner(sweep)
    except UsageError as error:
        raise UsageError(
            f"{shown(table)}: its cases cannot be run again ({error}): run one with its command,"
            " and view that result"
        ) from None
    if planner.digest != metadata.get(DIGEST):
        raise UsageError(
            f"{shown(table)}: was made with another scene, mechanism or dockloop than these: its"
            " cases would not be the same; run the sweep again"
        )
    names = [quantity.name for quantity in sweep.quantities]
    row = open_table(table).read_row(case - 1, [*names, "end_time"])
    return planner.make_command(tuple(row[name] for name in names), row["end_time"])


def _list_values(words: list[str], option: str) -> list[str]:
    """Return what follows an option in the words of a command."""
    return [words[i + 1] for i, word in enumerate(words[:-1]) if word == option]


def _name(source: Path, suffix: str) -> Path:
    return source.parent / f"{source.stem}_view{suffix}"  # `with_name` fails for "."


def _list_files(output: Path, options: argparse.Namespace) -> list[tuple[Path, Kind]]:
    """Return all files that are written, and their kinds."""
    if options.film:
        return [(output, FILM)]
    if not options.still:
        return [(output, PAGE)]
    count = len(options.still.split(","))
    if count == 1:
        return [(output, STILL)]
    return [(output.with_stem(f"{output.stem}_{i + 1}"), STILL) for i in range(count)]


def _parse_moments(text: str, run: Result) -> list[float | str]:
    """Return times [s] and events."""
    known = {event["key"] for event in find_events(run)}
    known |= {"peak"} if any(key.startswith("peak_") for key in known) else set()
    times = run["time"]
    moments: list[str | float] = []
    for word in (word.strip() for word in text.split(",")):
        if word in known:
            moments.append(word)
            continue
        try:
            moment = read_number(word)
        except ValueError:
            raise UsageError(
                f"--still {word}: is no time, and no event of this result"
                f"{did_you_mean(word, known)}: there are {', '.join(sorted(known))}"
            ) from None
        if not times[0] <= moment <= times[-1]:
            raise UsageError(
                f"--still {word}: the result goes from {times[0]:g} to {times[-1]:g} s"
            )
        moments.append(moment)
    return moments


def _parse_meshes(texts: list[str]) -> dict[str, Path]:
    """Return the meshes by vehicle."""
    meshes = {}
    for text in texts:
        vehicle, equals, file = text.partition("=")
        if not equals or vehicle not in ("chaser", "target") or not file:
            raise UsageError(f"--mesh {text}: must be chaser=FILE.stl or target=FILE.stl")
        meshes[vehicle] = Path(file)
    return meshes
