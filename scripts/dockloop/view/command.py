"""The command ``dockloop view``: page, stills or film of a result, or of cases of a sweep."""

import argparse
from pathlib import Path

from dockloop.base.errors import UsageError
from dockloop.base.files import claim
from dockloop.base.paths import shown
from dockloop.fmu.state import read_state
from dockloop.result.files import read_result
from dockloop.result.summary import RESULT
from dockloop.view.cases import view_sweep
from dockloop.view.mesh import read_mesh
from dockloop.view.write import list_files, write_files


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
    meshes = [read_mesh(text) for text in options.meshes]
    if source.suffix == ".parquet" and not _is_run(source):
        if options.model:
            raise UsageError("--model: the table of a sweep holds its model")
        return view_sweep(source, output, options, meshes)
    if options.cases or options.not_captured is not None:
        raise UsageError(f"--case, --not-captured: {shown(source)} is no table of a sweep")
    if (source.suffix == ".fmu") != bool(options.state):
        raise UsageError(f"{shown(source)}: an FMU and a --state go together, one needs the other")
    if options.state and (options.film or options.model):
        raise UsageError("--film, --model: a saved state is one moment of its own FMU")
    for file, kind in list_files(output, options):
        claim(file, kind)
    state = options.state
    run = read_state(source, state) if state else read_result(source, options.model)
    return write_files(run, output, options, meshes, None)


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


def _name(source: Path, suffix: str) -> Path:
    return source.parent / f"{source.stem}_view{suffix}"  # `with_name` fails for "."
