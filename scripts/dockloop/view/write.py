"""Writes what shows a docking: a page, stills, a film."""

import argparse
import re
from pathlib import Path

from dockloop.base.errors import UsageError, did_you_mean
from dockloop.base.files import Kind, scratch
from dockloop.base.number import read_number
from dockloop.base.paths import shown
from dockloop.result.recording import Result
from dockloop.view.page import PAGE, find_events, write_page
from dockloop.view.pictures import FILM, STILL, write_film, write_stills

_SIZE = re.compile(r"(\d{2,5})x(\d{2,5})")


def write_files(
    run: Result,
    output: Path,
    options: argparse.Namespace,
    meshes: list[tuple[str, dict]],
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
            files = [file for file, _ in list_files(output, options)]
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


def list_files(output: Path, options: argparse.Namespace) -> list[tuple[Path, Kind]]:
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
